"""A law on an arm: loops, drivers, limits, torque filter."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
