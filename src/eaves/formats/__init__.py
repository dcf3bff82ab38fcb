"""Reading and writing, one file per format; names load on first use, as the libraries they need are slow."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
