"""What is true of a closed loop: certificates, modes, gains, equilibria."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)
