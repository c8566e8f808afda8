"""Many runs: what varies, what is measured, and who simulates."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
