"""The results of a run: a summary that a notebook shows, tables, meshes, CityJSON, points."""

from __future__ import annotations

import csv
import html
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self
from urllib.parse import quote

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.detect.stage import HOUSE_M2, OBJECT
from eaves.extensions import imported
from eaves.figures.rows import MANUAL, BuildingRow, describe_model, has_defect, judge, lacks_model
from eaves.formats import InputError, read, read_polygons
from eaves.formats.crs import horizontal_crs, plane_part
from eaves.formats.errors import INSTALL
from eaves.formats.inputs import is_classified
from eaves.formats.models.cityjson import as_cityjson
from eaves.formats.models.cityjson_read import CityObject, models_of, read_head, read_models, system_of_head
from eaves.formats.models.meshes import mesh_of_solids
from eaves.formats.vectors.geopackage import Row
from eaves.formats.vectors.polygons import list_vector_layers, read_details
from eaves.formats.whole_files import atomic
from eaves.geometry.rings import polygon_parts
from eaves.model import (
    LOCAL_METRES,
    Block,
    BuildingModel,
    CoordinateSystem,
    Doubt,
    Failure,
    Footprint,
    PointCloud,
    Provenance,
)
from eaves.model.block import WIDE_SQUARE
from eaves.model.summary import Summary
from eaves.run.manifest import read_facts, read_manifest

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from trimesh import Trimesh

REVIEW, HOUSES = "review.csv", "primitives.csv"
COLUMNS = ("rank", "id", "trust", "worth_m2", "reason", "link", "x", "y")
"""Of review.csv; x and y are a place inside the building, in the units of the reference system."""

LEAST_WORTH_M2 = 30.0
"""Buildings of which less is wrong, in the mean, are left out: a garage."""
LEAST_SIDE = 1.0
"""Side (m) of the square that shows a doubt of less area: it must be seen on a map."""
LAYER = "the layer doubts of footprints.gpkg"
LEAST_FACE_M2 = 10.0
"""A smaller face in doubt (m² in plan) is in the layer `roof_planes`, where `weak` says why."""


def review_rows(buildings: Iterable[BuildingRow]) -> list[Row]:
    """The buildings of low trust, or with a defect that lowers it by itself, by the area that is likely
    wrong; of a map's polygons all that have no model.
    """
    rows = []
    for building in buildings:
        trust, badness, reason = judge(building.values)
        worth = badness * building.values["area_m2"]
        weak = trust == "low" or (trust != MANUAL and has_defect(building.values))
        if lacks_model(building.values) or (weak and worth >= LEAST_WORTH_M2):
            attributes = {
                "id": building.values["id"],
                "trust": trust,
                "worth_m2": round(worth, 1),
                "reason": reason,
                "link": f"report.html#building={quote(building.values['id'])}",
            }
            rows.append(Row(building.polygon, attributes))
    ordered = sorted(rows, key=lambda row: (-row.attributes["worth_m2"], row.attributes["id"]))
    return [Row(row.geometry, {**row.attributes, "rank": rank}) for rank, row in enumerate(ordered, 1)]


def write_review(path: Path, rows: Sequence[Row], system: CoordinateSystem) -> Path:
    """Write the rows of the layer `review` (world metres) as a table, also where there are none; its path."""
    records, unit = [], system.horizontal_unit_m
    for row in rows:
        place = {}
        if row.geometry is not None and not row.geometry.is_empty:
            point = row.geometry.representative_point()
            place = {"x": round(point.x / unit, 2), "y": round(point.y / unit, 2)}
        records.append({**row.attributes, **place})
    return write_table(path, records, COLUMNS)


def write_table(path: Path, records: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> Path:
    """Write those columns of records as a table, also where there are none; its path."""
    with atomic(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(records)
    return path


def distinct_doubts(doubts: Iterable[Doubt], side: float) -> list[Doubt]:
    """The doubts (world metres), each once, the largest first.

    What goes on beyond the surroundings that its block sees has another middle in each block, and so may be
    doubted in several: of those that overlap the largest stays. `side` is that of the blocks.
    """
    ordered = sorted(
        set(doubts), key=lambda doubt: (-doubt.area_m2, doubt.x, doubt.y, doubt.stage, doubt.reason)
    )
    return without_repeated(ordered, side)


def kind_of(doubt: Doubt) -> str:
    """What a doubt is about, without its numbers."""
    return doubt.reason.split(":")[0]


def objects_remark(doubts: Iterable[Doubt], buildings: int, unit: float, where: str) -> str | None:
    """The line on a scan in which more objects of the size of a house are no buildings than are; None where
    they are fewer. `unit` (m) is that of the system, `where` names what to open."""
    objects = [doubt for doubt in doubts if kind_of(doubt) == OBJECT]
    if len(objects) <= buildings:
        return None
    largest = max(objects, key=lambda doubt: doubt.area_m2)
    return (
        f"{len(objects):,} objects of {HOUSE_M2[0]:g} to {HOUSE_M2[1]:g} m² rise as high as houses and are "
        f"no buildings, {buildings:,} are; of the largest, at {largest.x / unit:.1f}, "
        f"{largest.y / unit:.1f}, {largest.reason.partition(': ')[2]}; all are doubts"
        f"{where and ' in ' + where}; if they are houses, --set detect.max_residual=0.5 takes rougher roofs"
    )


def doubt_row(doubt: Doubt) -> Row:
    """The row of a doubt: the square of its area about its middle."""
    columns = {"stage": doubt.stage, "reason": doubt.reason, "area_m2": doubt.area_m2}
    return Row(square_of(doubt), columns)


def face_doubts(rows: Iterable[BuildingRow]) -> Iterator[Doubt]:
    """Doubts (world metres) about the larger roof faces that their points do not support."""
    for row in rows:
        for polygon, face in row.faces:
            plan = face.get("projected_m2") or 0.0
            weak = face.get("weak")
            if weak is None or plan < LEAST_FACE_M2:
                continue
            kind = "a hole where a roof should be" if face.get("no_data") else "a face whose points scatter"
            middle = shapely.force_2d(polygon).representative_point()
            yield Doubt(round(middle.x, 2), round(middle.y, 2), float(plan), f"{kind}: {weak}", "roof")


def without_repeated(doubts: Sequence[Doubt], side: float) -> list[Doubt]:
    """The doubts, sorted by size, without those of which a neighbouring block has a larger one of the same
    kind that overlaps."""
    if not doubts:
        return []
    squares = [square_of(doubt) for doubt in doubts]
    larger, smaller = shapely.STRtree(squares).query(squares, predicate="intersects")
    keys = [(doubt.stage, kind_of(doubt)) for doubt in doubts]
    homes = [Block.at(doubt.x, doubt.y, WIDE_SQUARE if doubt.stage == "ground" else side) for doubt in doubts]
    dropped = np.zeros(len(doubts), bool)
    for k, n in zip(larger.tolist(), smaller.tolist(), strict=True):
        dropped[n] |= k < n and keys[k] == keys[n] and homes[k] != homes[n]
    return [doubt for doubt, gone in zip(doubts, dropped, strict=True) if not gone]


def square_of(doubt: Doubt) -> shapely.Polygon:
    """The square of a doubt's area about its middle."""
    half = 0.5 * max(LEAST_SIDE, math.sqrt(doubt.area_m2))
    return shapely.box(doubt.x - half, doubt.y - half, doubt.x + half, doubt.y + half)


def describe_doubts(doubts: Sequence[Doubt], unit: float, where: str) -> dict[str, Any]:
    """What run.json says of the doubts, sorted by size: how many, and of each kind how many, their area and
    the largest, its place in the reference system's unit, of so many metres; `where` names what to open.
    """
    groups = dict[tuple[str, str], list[Doubt]]()
    for doubt in doubts:
        groups.setdefault((doubt.stage, kind_of(doubt)), []).append(doubt)
    kinds = []
    for (stage, _), places in groups.items():
        x, y = (round(round(value, 2) / unit, 2) for value in (places[0].x, places[0].y))
        area = round(sum(doubt.area_m2 for doubt in places), 1)
        kinds.append(
            {
                "stage": stage,
                "count": len(places),
                "area_m2": area,
                "reason": places[0].reason,
                "x": x,
                "y": y,
            }
        )
    return {"count": len(doubts), "see": where, "kinds": sorted(kinds, key=lambda one: -one["area_m2"])}


FOOTPRINTS, MODELS = "footprints.gpkg", "buildings.city.jsonl"
COUNTS = (
    *("points", "points_used", "found", "modelled"),
    *("by_lod", "failures", "fallbacks", "trust"),
)
"""Fields of a summary that run.json has by the same names."""


@dataclass(frozen=True)
class Results(Summary):
    """The summary of a run with what it made: tables, meshes, CityJSON, points, each read when first used.

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
    >>> len(Results(Path("out"), 1000, 2, 2, {"2.2": 2}, {}, {}, {}, 1.5, ()))
    2
    """

    def __repr__(self) -> str:
        first = self.as_text().split("\n")[:2]
        return "\n".join([f"Results in {self.folder}", *first])

    def __len__(self) -> int:
        return self.found

    @classmethod
    def of(cls, summary: Summary) -> Self:
        """The same, with what the run made."""
        return cls(**vars(summary))

    def _repr_html_(self) -> str:
        lines = html.escape(self.as_text()).replace("\n", "<br>")
        path, picture = self.folder / FOOTPRINTS, ""
        if path.exists():
            shapes = read_polygons(path, layer="footprints")[0]
            polygon_svg = imported("eaves.report.pictures:polygon_svg")
            picture = f"<br>{polygon_svg(*chain.from_iterable(map(polygon_parts, shapes)))}"
        names = ", ".join(html.escape(path.name) for path in self.files)
        return f"<div><b>eaves</b><br>{lines}{picture}<br><small>{names}</small></div>"

    @cached_property
    def footprints(self) -> GeoDataFrame:
        """One row a building, with all columns of docs/columns.md, in the plane of the run's system."""
        return table_of(self.folder, "footprints")

    @cached_property
    def planes(self) -> GeoDataFrame:
        """One row a roof face, its polygon with heights; `building_id` is the `id` of its footprint."""
        return table_of(self.folder, "roof_planes")

    @cached_property
    def doubts(self) -> GeoDataFrame:
        """One row a place that the scan leaves undecided, with the reason."""
        return table_of(self.folder, "doubts")

    @cached_property
    def models(self) -> dict[str, Trimesh]:
        """A closed trimesh.Trimesh of every building's finest level by its id, as `to_trimesh` makes it."""
        path = self.folder / MODELS
        models = read_models(path) if path.exists() else ()
        return {model.footprint.id: to_trimesh(model) for model in models if isinstance(model, BuildingModel)}

    @cached_property
    def cityjson(self) -> dict[str, Any]:
        """All buildings as one CityJSON object."""
        path = self.folder / MODELS
        return as_cityjson(read_models(path), system_of_head(read_head(path), path))

    def point_cloud(self, building: int | None = None) -> PointCloud:
        """The classified points, of one building by its `number`, or all."""
        files = [path for path in self.files if is_classified(path.name)]
        if not files:
            raise InputError.about(self.folder, "holds no classified points", "build with all outputs")
        cloud = read(files, fields=("building_id",))
        return cloud if building is None else cloud[cloud.fields["building_id"] == building]


class ModelledBuildings(NamedTuple):
    """The buildings of inputs as `build` writes them.

    Parameters
    ----------
    models : list of BuildingModel or Failure
        In metres about the origins of their footprints.
    system : CoordinateSystem
        What files of them are written in.
    provenance : Provenance
        What they are made from.

    Examples
    --------
    >>> import eaves
    >>> models, system, provenance = eaves.model_buildings("tile.laz")    # doctest: +SKIP
    """

    models: list[BuildingModel | Failure]
    system: CoordinateSystem
    provenance: Provenance


def open_results(folder: str | Path, allow_failures: bool = False) -> Results:
    """The results of a finished run.

    Parameters
    ----------
    folder : str or Path
        Output folder of `eaves build`, `eaves.build` or `eaves.update`.
    allow_failures : bool
        Open a run of which a part could not be computed.

    Returns
    -------
    Results
        As the run returned them.

    Raises
    ------
    InputError
        When the folder holds no run, one that has not ended, or one of a version that noted less.
    IncompleteRunError
        When a part could not be computed; it carries the results.

    Examples
    --------
    >>> import eaves
    >>> eaves.open_results("out").footprints                              # doctest: +SKIP
    """
    place = Path(folder)
    noted = read_manifest(place)
    facts = read_facts(place)
    if not noted["complete"] and not facts.get("incomplete"):
        raise InputError.about(
            place, "holds a run that has not ended", "wait for it, or build again with resume=True"
        )
    try:
        counts = {name: facts[name] for name in COUNTS}
        results = Results(
            place,
            **counts,
            seconds=facts["stage_cpu_seconds"],
            elapsed=facts["elapsed_seconds"],
            files=tuple(place / name for name in noted["written"]),
            failed=tuple(facts["incomplete"]),
            run=facts,
            wall=facts["step_wall_seconds"],
        )
    except KeyError as missing:
        version = facts.get("version", "unknown")
        raise InputError.about(
            place, f"holds a run of eaves {version}, which noted no {missing} in run.json", "build again"
        ) from None
    return results.checked(allow_failures)


Outlined = Footprint | BuildingModel | Failure


def to_geopandas(
    what: Summary | ModelledBuildings | Mapping[str, CityObject] | Outlined | Iterable[Outlined],
    system: CoordinateSystem = LOCAL_METRES,
) -> GeoDataFrame:
    """Footprints, models, failures or a run's results as a table of outlines.

    Parameters
    ----------
    what : Results, ModelledBuildings, mapping of str to CityObject, Footprint, BuildingModel, Failure
        Or several of the last three. Failures without an outline are left out.
    system : CoordinateSystem
        Reference system of outlines and models; the others know their own.

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
    if isinstance(what, Summary):
        return table_of(what.folder, "footprints")
    if isinstance(what, ModelledBuildings):
        return to_geopandas(what.models, what.system)
    if isinstance(what, Mapping):
        known = next((one.system for one in what.values()), system)
        return to_geopandas(models_of(what.values()), known)
    several = [what] if isinstance(what, Footprint | BuildingModel | Failure) else list(what)
    rows, shapes = [], []
    for item in several:
        outline = item if isinstance(item, Footprint) else item.footprint
        if outline is None:
            continue
        about = (
            {"id": item.id, "score": item.score, **item.attributes}
            if isinstance(item, Footprint)
            else describe_model(item)
        )
        shapes.append(outline.world)
        rows.append(about)
    return frame_of(rows, shapes, system)


def frame_of(
    rows: Sequence[Mapping[str, Any]], shapes: Sequence[BaseGeometry], system: CoordinateSystem
) -> GeoDataFrame:
    """Rows with their shapes (world metres) as a geopandas.GeoDataFrame in a system."""
    frame = required_library("geopandas").GeoDataFrame
    moved = shapely.transform(np.array(shapes, object), lambda xy: xy / system.horizontal_unit_m)
    return frame(rows, geometry=moved, crs=horizontal_crs(system))


def table_of(folder: Path, layer: str) -> GeoDataFrame:
    """A layer of a run as a geopandas.GeoDataFrame in the plane of the run's system; footprints with all
    columns."""
    read, path = required_library("geopandas").read_file, folder / FOOTPRINTS
    if not path.exists():
        raise InputError.about(path, "is not there", "build with outputs= that name footprints")
    if layer not in (one.name for one in list_vector_layers(path)):  # none is written of no rows
        frame = read(path, layer="footprints", columns=[]).iloc[:0]
    else:
        frame = read(path, layer=layer)
    if layer == "footprints" and read_details(path):
        frame = frame.merge(read(path, layer="attributes"), on="id", how="left")
    plane = None if frame.crs is None else plane_part(frame.crs)
    return frame if plane is None else frame.set_crs(plane, allow_override=True)


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
    if not isinstance(model, BuildingModel) or not model.solids:
        raise ValueError("the model has no solids; a failure or a model at LoD 0 has no mesh")
    mesh = mesh_of_solids(model.solids[model.lod])
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
