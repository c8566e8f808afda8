"""The command line: ``phcontrol run``, ``view``, ``certify``, ``reproduce``, ``robots``, ``controllers``."""

from phcontrol.cli.application import app, main

__all__ = ["app", "main"]
