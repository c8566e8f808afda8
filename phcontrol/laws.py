"""Laws, what they are made of, their schedules and energy tanks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
