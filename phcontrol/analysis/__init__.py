"""What can be proved and computed about a closed loop."""
