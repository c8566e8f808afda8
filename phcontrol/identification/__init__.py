"""What of an arm's model can be told from how it moves, and motions that tell it."""
