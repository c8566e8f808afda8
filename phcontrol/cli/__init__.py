"""The command line; ``application`` lists its commands."""

from phcontrol.cli.application import app, main

__all__ = ["app", "main"]
