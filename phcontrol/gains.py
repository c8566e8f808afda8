"""Gains from a specification, and gains that are tuned."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
