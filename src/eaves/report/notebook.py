"""Results for notebooks: an HTML summary, GeoDataFrames, arrays, meshes."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import shapely

from eaves.figures.rows import building_row, world_polygon
from eaves.formats import iter_cityjson, read_polygons
from eaves.formats.crs import horizontal_crs
from eaves.formats.errors import INSTALL
from eaves.formats.models.meshes import mesh_of
from eaves.formats.vectors.polygons import read_details
from eaves.model import (
    LOCAL_METRES,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Footprint,
)
from eaves.model.summary import Summary
from eaves.report.contents import finest_faces, system_of_folder
from eaves.report.sample import Sample, classified_files, sample_points
from eaves.report.surfaces import collect_city_faces

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from trimesh import Trimesh

FILE_DIGITS = 4
"""Decimals (m) of a file's corners; rounded to them, those of neighbouring faces are one."""


@dataclass(frozen=True)
class Results(Summary):
    """The summary of a run, with its results as tables, arrays and meshes for notebooks.

    Parameters
    ----------
    folder : Path
        Folder of the outputs.
    points, found, modelled : int
        Numbers of points, of buildings, and of buildings with a model.
    by_lod, failures, fallbacks : dict of str to int
        Models by level of detail; buildings without a model, and with a coarser one than asked for, by code.
    seconds : dict of str to float
        Processor time (s) of each stage, over all processes.
    elapsed : float
        Time (s) from start to end.
    files : tuple of Path
        The files written.
    failed : tuple of str
        Inputs and blocks that could not be used, with the reason.
    run : dict
        The content of run.json.
    wall : dict of str to float
        Time on the clock (s) of each step, where it was measured.
    points_used : int or None
        Points within bounds and clip area that are not withheld; 0 is an empty result.
    trust : dict of str to int
        Buildings by trust: high, medium, low; those without a model are low.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves import Results
    >>> Results(Path("out"), 1000, 2, 2, {"2.2": 2}, {}, {}, {}, 1.5, ()).found
    2
    """

    def __repr__(self) -> str:
        first = self.as_text().split("\n")[:2]
        return "\n".join([f"Results in {self.folder}", *first])

    @classmethod
    def of(cls, summary: Summary) -> Self:
        """The same, with the tables, arrays and meshes."""
        return cls(**vars(summary))

    def _repr_html_(self) -> str:
        lines = html.escape(self.as_text()).replace("\n", "<br>")
        picture = ""
        files = [self.folder / name for name in ("dsm.tif", "footprints.gpkg")]
        if find_spec("matplotlib") is not None and all(path.exists() for path in files):
            from eaves.report.plots.drawings import plan_figure

            buffer = io.BytesIO()
            plan_figure(self.folder, 5.0).savefig(buffer, format="png", dpi=100)
            encoded = base64.b64encode(buffer.getvalue()).decode("ascii")
            picture = f"<br><img alt='plan of the buildings' src='data:image/png;base64,{encoded}'>"
        names = ", ".join(html.escape(path.name) for path in self.files)
        return f"<div><b>eaves</b><br>{lines}{picture}<br><small>{names}</small></div>"

    def footprints(self) -> GeoDataFrame:
        """The footprints as a geopandas.GeoDataFrame (the extra `notebook`)."""
        return footprint_frame(self.folder)

    def roof_planes(self) -> GeoDataFrame:
        """The roof faces as a geopandas.GeoDataFrame (the extra `notebook`)."""
        return footprint_frame(self.folder, "roof_planes")

    def point_arrays(self, building: int | None = None) -> Sample:
        """The classified points (of one building by its number, or all) as arrays, in world metres."""
        return sample_points(
            classified_files(self.folder), system_of_folder(self.folder) or LOCAL_METRES, building=building
        )

    def meshes(self) -> dict[str, Trimesh]:
        """A trimesh.Trimesh of every building's finest model, by id (the extra `notebook`), in m
        about the building's lowest corner, which `metadata["origin"]` holds."""
        trimesh = required_library("trimesh")
        _, _, rows, _ = read_polygons(self.folder / "footprints.gpkg", layer="footprints")
        ids = [str(row["id"]) for row in rows]
        models = iter_cityjson(self.folder / "buildings.city.jsonl")
        faces = collect_city_faces(models, {name: number for number, name in enumerate(ids)})
        finest, meshes = finest_faces(faces), {}
        for number, name in enumerate(ids):
            building_faces = faces.take(finest & (faces.building == number))
            if not building_faces:
                continue
            corners = building_faces.table.corners[building_faces.table.triangles()[0]]
            origin = np.floor(corners.min(axis=(0, 1)))
            meshes[name] = trimesh.Trimesh(
                np.round(corners - origin, FILE_DIGITS).reshape(-1, 3),
                np.arange(3 * len(corners)).reshape(-1, 3),
                metadata={"origin": origin, "id": name},
                process=True,
            )
        return meshes


Outlined = Footprint | BuildingModel | Failure


def to_geopandas(
    what: Summary | Outlined | Iterable[Outlined], system: CoordinateSystem = LOCAL_METRES
) -> GeoDataFrame:
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
    geopandas = required_library("geopandas")
    if isinstance(what, Summary):
        return footprint_frame(what.folder)
    several = [what] if isinstance(what, Footprint | BuildingModel | Failure) else list(what)
    rows, shapes = [], []
    unit = system.horizontal_unit_m
    for item in several:
        outline = item if isinstance(item, Footprint) else item.footprint
        if outline is None:
            continue
        about = (
            {"id": item.id, "score": item.score, **item.attributes}
            if isinstance(item, Footprint)
            else building_row(item)
        )
        shapes.append(shapely.transform(world_polygon(outline), lambda xy: xy / unit))
        rows.append(about)
    return geopandas.GeoDataFrame(rows, geometry=shapes, crs=horizontal_crs(system))


def footprint_frame(folder: Path, layer: str = "footprints") -> GeoDataFrame:
    """A layer of a run as a geopandas.GeoDataFrame, in the run's reference system; footprints
    with all columns."""
    read, path = required_library("geopandas").read_file, folder / "footprints.gpkg"
    frame = read(path, layer=layer)
    has_details = layer == "footprints" and bool(read_details(path))
    return frame.merge(read(path, layer="attributes"), on="id", how="left") if has_details else frame


def to_trimesh(model: BuildingModel) -> Trimesh:
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
    trimesh = required_library("trimesh")
    mesh = mesh_of(model)
    if mesh is None:
        raise ValueError("the model has no solids; a failure or a model at LoD 0 has no mesh")
    about = {"id": model.footprint.id, "lod": model.lod, "origin": model.footprint.origin}
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, metadata=about, process=False)


def required_library(name: str) -> Any:
    """A library of the extra `notebook`.

    Raises
    ------
    ImportError
        In one line with the remedy, when it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise ImportError(f"{name} is not installed; {INSTALL.format('notebook')}") from None
