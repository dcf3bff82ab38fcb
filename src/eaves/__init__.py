"""eaves: from raw airborne LiDAR to building footprints and valid 3D building models.

Names load their module when they are first used; `dir(eaves)` lists them all.

>>> import eaves
>>> cloud = eaves.read("tile.laz")                                        # doctest: +SKIP
>>> classified = eaves.classify_ground(cloud, "adaptive_tin")             # doctest: +SKIP
>>> results = eaves.build("tile.laz", "out", jobs=2)                      # doctest: +SKIP
"""

import functools
import types
from collections.abc import Callable
from importlib import import_module
from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


@functools.cache
def __getattr__(name: str) -> object:
    """A public name, or the version, whose look-up takes longer than the rest of this import."""
    if name == "__version__":
        from importlib.metadata import version

        return version("eaves")
    thing = _load(name)
    globals()[name] = thing = _by_call(thing) if isinstance(thing, types.FunctionType) else thing
    return thing


def _by_call(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, whose refusals name keywords where those of the command name its options."""

    @functools.wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        try:
            return function(*args, **options)
        except (TypeError, ValueError) as error:
            if "--" in str(error) and len(error.args) == 1:
                # by string: the package itself imports no room
                options_of_a_run = import_module("eaves.run.options")
                error.args = (options_of_a_run.in_python(str(error)),)
            raise

    return called
