"""Results for the libraries of notebooks: geopandas and trimesh."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import shapely

from eaves.figures.rows import building_row, world_polygon
from eaves.formats.crs import horizontal_crs
from eaves.formats.models.meshes import mesh_of
from eaves.formats.vectors.geopackage import read_details
from eaves.model import (
    LOCAL_METRES,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Footprint,
)
from eaves.model.summary import Summary

Outlined = Footprint | BuildingModel | Failure
EXTRA = "eaves[notebook]"


def to_geopandas(
    what: Summary | Outlined | Iterable[Outlined], system: CoordinateSystem = LOCAL_METRES
) -> Any:
    """Footprints, models, failures or a run's results as a table of outlines.

    Parameters
    ----------
    what : Results, Footprint, BuildingModel, Failure, or several of the last three
        Failures without an outline are left out.
    system : CoordinateSystem
        Reference system of what is no run; a run knows its own.

    Returns
    -------
    geopandas.GeoDataFrame
        One row a building, in the system's units, with its attributes.

    Raises
    ------
    ImportError
        When geopandas is not installed.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=1.0)
    >>> len(eaves.to_geopandas([building.model() for building in truth.buildings]))
    9
    """
    geopandas = required_library("geopandas", EXTRA)
    if isinstance(what, Summary):
        return footprint_frame(what.folder)
    several = [what] if isinstance(what, Footprint | BuildingModel | Failure) else list(what)
    rows, shapes = [], []
    unit = system.horizontal_unit_m
    for one in several:
        outline = one if isinstance(one, Footprint) else one.footprint
        if outline is None:
            continue
        about = (
            {"id": one.id, "score": one.score, **one.attributes}
            if isinstance(one, Footprint)
            else building_row(one)
        )
        shapes.append(shapely.transform(world_polygon(outline), lambda xy: xy / unit))
        rows.append(about)
    return geopandas.GeoDataFrame(rows, geometry=shapes, crs=horizontal_crs(system))


def footprint_frame(folder: Path, layer: str = "footprints") -> Any:
    """A layer of a run as a geopandas.GeoDataFrame, in the run's reference system; footprints
    with all columns."""
    read, path = required_library("geopandas", EXTRA).read_file, folder / "footprints.gpkg"
    frame = read(path, layer=layer)
    whole = layer == "footprints" and bool(read_details(path))
    return frame.merge(read(path, layer="attributes"), on="id", how="left") if whole else frame


def to_trimesh(model: BuildingModel) -> Any:
    """The finest level of a model as a closed mesh, in metres about its footprint's origin.

    Parameters
    ----------
    model : BuildingModel
        With solids.

    Returns
    -------
    trimesh.Trimesh
        `metadata` has `id`, `lod` and `origin` (world metres).

    Raises
    ------
    ImportError
        When trimesh is not installed.
    ValueError
        When the model has no solids.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> eaves.to_trimesh(nine_roofs_on_a_slope(density=1.0).buildings[0].model()).is_watertight
    True
    """
    trimesh = required_library("trimesh", EXTRA)
    mesh = mesh_of(model)
    if mesh is None:
        raise ValueError("the model has no solids; a failure or a model at LoD 0 has no mesh")
    about = {"id": model.footprint.id, "lod": model.lod, "origin": model.footprint.origin}
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, metadata=about, process=False)


def required_library(name: str, remedy: str) -> Any:
    """A library that is not needed elsewhere.

    Raises
    ------
    ImportError
        In one line with the remedy, when it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise ImportError(f"{name} is not installed; pip install '{remedy}'") from None
