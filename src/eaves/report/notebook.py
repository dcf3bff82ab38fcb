"""A run's results for notebooks: an HTML summary, GeoDataFrames, arrays, meshes."""

from __future__ import annotations

import base64
import html
import io
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Self

import numpy as np

from eaves.formats import iter_cityjson, read_polygons
from eaves.model import LOCAL_METRES
from eaves.model.summary import Summary
from eaves.report.contents import finest_faces, system_of_folder
from eaves.report.convert import footprint_frame, required_library
from eaves.report.sample import Sample, classified_files, sample_points
from eaves.report.surfaces import collect_city_faces

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

    @classmethod
    def of(cls, summary: Summary) -> Self:
        """The same, with the tables, arrays and meshes."""
        return cls(**vars(summary))

    def _repr_html_(self) -> str:
        lines = html.escape(self.as_text()).replace("\n", "<br>")
        picture = ""
        files = [self.folder / name for name in ("dsm.tif", "footprints.gpkg")]
        if find_spec("matplotlib") is not None and all(path.exists() for path in files):
            from eaves.report.plots.plan import plan_figure

            buffer = io.BytesIO()
            plan_figure(self.folder, 5.0).savefig(buffer, format="png", dpi=100)
            encoded = base64.b64encode(buffer.getvalue()).decode("ascii")
            picture = f"<br><img alt='plan of the buildings' src='data:image/png;base64,{encoded}'>"
        names = ", ".join(html.escape(path.name) for path in self.files)
        return f"<div><b>eaves</b><br>{lines}{picture}<br><small>{names}</small></div>"

    def footprints(self) -> Any:
        """The footprints as a geopandas.GeoDataFrame (`pip install eaves[notebook]`)."""
        return footprint_frame(self.folder)

    def roof_planes(self) -> Any:
        """The roof faces as a geopandas.GeoDataFrame (`pip install eaves[notebook]`)."""
        return footprint_frame(self.folder, "roof_planes")

    def point_arrays(self, building: int | None = None) -> Sample:
        """The classified points (of one building by its number, or all) as arrays, in world metres."""
        return sample_points(
            classified_files(self.folder), system_of_folder(self.folder) or LOCAL_METRES, building=building
        )

    def meshes(self) -> dict[str, Any]:
        """A trimesh.Trimesh of every building's finest model, by id (`pip install eaves[notebook]`), in m
        about the building's lowest corner, which `metadata["origin"]` holds."""
        trimesh = required_library("trimesh", "eaves[notebook]")
        _, _, rows, _ = read_polygons(self.folder / "footprints.gpkg", layer="footprints")
        ids = [str(row["id"]) for row in rows]
        models = iter_cityjson(self.folder / "buildings.city.jsonl")
        faces = collect_city_faces(models, {name: number for number, name in enumerate(ids)})
        finest, meshes = finest_faces(faces), {}
        for number, name in enumerate(ids):
            own = faces.take(finest & (faces.building == number))
            if not own:
                continue
            corners = own.table.corners[own.table.triangles()[0]]
            origin = np.floor(corners.min(axis=(0, 1)))
            meshes[name] = trimesh.Trimesh(
                np.round(corners - origin, FILE_DIGITS).reshape(-1, 3),
                np.arange(3 * len(corners)).reshape(-1, 3),
                metadata={"origin": origin, "id": name},
                process=True,
            )
        return meshes
