"""The version, in one place."""

__version__ = "0.2.0"
"""The version of the package.

Example:
    >>> import phcontrol
    >>> phcontrol.__version__.count(".")
    2
"""
