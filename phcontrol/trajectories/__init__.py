"""Where an arm should be, and when."""
