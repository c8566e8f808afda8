"""What acts on an arm from outside."""
