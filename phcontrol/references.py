"""Along what an arm or a frame is led, also while goals change."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
