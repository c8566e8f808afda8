"""Closed loops in time."""
