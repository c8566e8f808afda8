"""Energy-based control of robot arms, with a certificate for every controller.

The public names are listed in ``__init__.pyi``; each is loaded with the first use of it, so that ``import phcontrol``
costs a few milliseconds, and a program loads what it uses.
"""

import lazy_loader

from phcontrol._version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
