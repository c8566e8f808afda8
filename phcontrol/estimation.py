"""What an arm carries and how it rubs, from logs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
