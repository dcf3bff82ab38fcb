"""Results for the libraries of notebooks: geopandas, xarray, trimesh, open3d, and a map to look around."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from eaves.buildings.rows import building_row, world_polygon
from eaves.formats.crs import horizontal_crs
from eaves.formats.models.meshes import BuildingMesh, mesh_of
from eaves.formats.vectors.geopackage import read_details
from eaves.model import (
    LOCAL_METRES,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Footprint,
    PointCloud,
    Raster,
    Scene,
)
from eaves.model.pictures import class_colours
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


def to_xarray(what: Raster | Scene, origin: tuple[float, float] = (0.0, 0.0), name: str = "height") -> Any:
    """A raster as a DataArray, a scene as a Dataset of dtm and dsm, placed by the middles of the cells.

    Parameters
    ----------
    what : Raster or Scene
        A scene knows its origin.
    origin : (float, float)
        World metres of a raster's local (0, 0).
    name : str
        Of the DataArray.

    Returns
    -------
    xarray.DataArray or xarray.Dataset
        Heights (y, x) in metres, row 0 north; NaN is no data.

    Raises
    ------
    ImportError
        When xarray is not installed.

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> import numpy as np
    >>> import eaves
    >>> raster = eaves.Raster(np.zeros((2, 3), np.float32), west=10.0, north=20.0, cell=0.5)
    >>> find_spec("xarray") is None or eaves.to_xarray(raster).shape == (2, 3)
    True
    """
    xarray = required_library("xarray", EXTRA)
    if isinstance(what, Scene):
        place = what.cloud.origin
        return xarray.Dataset({key: to_xarray(getattr(what, key), place, key) for key in ("dtm", "dsm")})
    rows, columns = what.shape
    x = what.west + origin[0] + (np.arange(columns) + 0.5) * what.cell
    y = what.north + origin[1] - (np.arange(rows) + 0.5) * what.cell
    return xarray.DataArray(
        what.values, dims=("y", "x"), coords={"x": x, "y": y}, name=name, attrs={"units": "m"}
    )


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
    mesh = solid_mesh(model)
    about = {"id": model.footprint.id, "lod": model.lod, "origin": model.footprint.origin}
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, metadata=about, process=False)


def to_open3d(what: PointCloud | BuildingModel) -> Any:
    """Points, coloured by class where they have one, or the finest level of a model, for open3d.

    Parameters
    ----------
    what : PointCloud or BuildingModel
        Coordinates stay local, in metres about `origin`.

    Returns
    -------
    open3d.geometry.PointCloud or open3d.geometry.TriangleMesh
        For `open3d.visualization.draw_geometries`.

    Raises
    ------
    ImportError
        When open3d is not installed.
    ValueError
        When a model has no solids.

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> cloud = nine_roofs_on_a_slope(density=1.0).cloud
    >>> find_spec("open3d") is None or len(eaves.to_open3d(cloud).points) == len(cloud)
    True
    """
    open3d = required_library("open3d", "open3d")
    if isinstance(what, PointCloud):
        points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(what.xyz))
        if what.classification is not None:
            colours = class_colours(what.classification) / 255.0
            points.colors = open3d.utility.Vector3dVector(colours)
        return points
    mesh = solid_mesh(what)
    made = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices),
        open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32)),
    )
    made.compute_triangle_normals()
    return made


def solid_mesh(model: BuildingModel) -> BuildingMesh:
    """The triangles of a model; ValueError where it has no solids."""
    mesh = mesh_of(model)
    if mesh is None:
        raise ValueError("the model has no solids; a failure or a model at LoD 0 has no mesh")
    return mesh


def explore(
    what: Summary | Outlined | Iterable[Outlined], system: CoordinateSystem = LOCAL_METRES, **options: Any
) -> Any:
    """A map to look around in, as `geopandas.GeoDataFrame.explore` makes it: by level of detail, else plain.

    Parameters
    ----------
    what : Results, Footprint, BuildingModel, Failure, or several of the last three
        As for `to_geopandas`.
    system : CoordinateSystem
        Reference system of what is no run.
    **options : object
        Of geopandas' `explore`; `tiles=None` needs no network.

    Returns
    -------
    folium.Map
        Shown by a notebook.

    Raises
    ------
    ImportError
        When geopandas, folium or mapclassify is not installed.

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> models = [building.model() for building in nine_roofs_on_a_slope(density=1.0).buildings]
    >>> find_spec("mapclassify") is None or "lod" in eaves.explore(models, tiles=None).get_root().render()
    True
    """
    for name in ("folium", "mapclassify"):
        required_library(name, EXTRA)
    table = to_geopandas(what, system)
    if "lod" in table.columns:
        options = {"column": "lod", "categorical": True, **options}
    return table.explore(**options)


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
