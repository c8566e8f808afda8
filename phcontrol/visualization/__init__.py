"""Pictures of runs. Nothing here is imported before it is used."""
