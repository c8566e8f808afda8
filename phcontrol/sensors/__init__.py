"""What a controller is shown of the truth."""
