"""eaves: from raw airborne LiDAR to building footprints and valid 3D building models.

Names load their module when they are first used; `dir(eaves)` lists them all.

>>> import eaves
>>> cloud = eaves.read("tile.laz")                                        # doctest: +SKIP
>>> classified = eaves.classify_ground(cloud, "adaptive_tin")             # doctest: +SKIP
>>> results = eaves.build("tile.laz", "out", jobs=2)                      # doctest: +SKIP
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("eaves")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
