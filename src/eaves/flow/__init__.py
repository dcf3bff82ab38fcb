"""A whole run: what is asked for, its steps in order, tiles, and the files that it writes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
