"""What keeps a torque inside the limits of an arm."""
