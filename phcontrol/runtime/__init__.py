"""A law on an arm, in real time."""
