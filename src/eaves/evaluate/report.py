"""The report of an evaluation: figures as JSON, rows as CSV and GeoPackage, the map as GeoTIFF."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from eaves.evaluate.detection_scores import (
    CELL,
    burn_labels,
    common_grid,
    evaluate_detection,
    kind_of,
    open_buildings,
    plane_image,
)
from eaves.evaluate.footprint_scores import Shapes, evaluate_footprints
from eaves.evaluate.matching import Agreement, evaluate_ground
from eaves.evaluate.models import evaluate_models, lay_points, read_buildings, roofs_of
from eaves.evaluate.roof_planes import evaluate_planes
from eaves.formats import InputError, atomic, checked_vector, read, read_polygons
from eaves.geometry import measure_spacing
from eaves.model import (
    BUILDING,
    GROUND,
    LOCAL_METRES,
    CoordinateSystem,
    Integers,
    Mask,
    PointCloud,
    Points,
    Raster,
    Values,
)
from eaves.validate import validate_file

COLOURS = {1: (60, 160, 60, 255), 2: (60, 90, 200, 255), 3: (210, 60, 50, 255), 255: (200, 200, 200, 255)}
"""Of the map: found green, missed blue, false red, unknown grey."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The figures of an evaluation, with a row an object and perhaps a map.

    Parameters
    ----------
    what : str
        `ground`, `detection`, `footprints`, `planes` or `models`.
    result, reference : str
        Names of the files compared.
    figures : dict of str to float, int or str
        Measure → value; NaN where there is nothing to divide by.
    rows : tuple of dict
        One an object.
    shapes : tuple of Polygon or MultiPolygon
        The polygon of each row, where rows are places.
    map : ndarray (H, W) of uint8 or None
        Map of where result and reference agree.
    grid : Raster or None
        Place of the map.
    system : CoordinateSystem
        Reference system of shapes and map.

    Examples
    --------
    >>> from eaves.evaluate import Evaluation
    >>> Evaluation("ground", "mine.laz", "true.laz", {"total error": 0.02}).figures["total error"]
    0.02
    """

    what: str
    result: str
    reference: str
    figures: dict[str, float | int | str]
    rows: tuple[dict[str, Any], ...] = ()
    shapes: tuple[Polygon | MultiPolygon, ...] = ()
    map: NDArray[np.uint8] | None = field(default=None, repr=False)
    grid: Raster | None = field(default=None, repr=False)
    system: CoordinateSystem = LOCAL_METRES

    def table(self) -> list[tuple[str, str]]:
        """Rows of (measure, value as text); what has nothing to divide by is a dash."""
        return [(name, _text(value)) for name, value in self.figures.items()]

    def as_text(self) -> str:
        """The table with its columns aligned."""
        rows = self.table()
        width = max((len(name) for name, _ in rows), default=0)
        head = f"{self.what}: {self.result} against {self.reference}"
        return "\n".join([head, *(f"  {name:<{width}}  {value}" for name, value in rows)])


def write_report(evaluation: Evaluation, folder: str | Path) -> list[Path]:
    """Write `<what>.json`, `<what>.csv` with the rows, `.gpkg` and `.tif` if there are places and a map.

    Parameters
    ----------
    evaluation : Evaluation
        The figures, rows and map.
    folder : str or Path
        Made when missing.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.evaluate import Evaluation, write_report
    >>> evaluation = Evaluation("ground", "mine.laz", "true.laz", {"total error": 0.02})
    >>> [path.name for path in write_report(evaluation, "report")]
    ['ground.json']
    """
    stem = Path(folder) / evaluation.what
    written = [stem.with_suffix(".json")]
    document = {
        "what": evaluation.what,
        "result": evaluation.result,
        "reference": evaluation.reference,
        "figures": _json_value(evaluation.figures),
        "rows": _json_value(evaluation.rows),
    }
    with atomic(written[0]) as temporary:
        temporary.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if evaluation.rows:
        written.append(stem.with_suffix(".csv"))
        with atomic(written[-1]) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(evaluation.rows[0]))
            writer.writeheader()
            writer.writerows(_json_value(evaluation.rows))
    if evaluation.shapes:
        from eaves.formats import Row, write_polygons

        written.append(stem.with_suffix(".gpkg"))
        places = [Row(shape, row) for shape, row in zip(evaluation.shapes, evaluation.rows, strict=True)]
        write_polygons(written[-1], places, evaluation.system, layer=evaluation.what)
    if evaluation.map is not None and evaluation.grid is not None:
        written.append(stem.with_suffix(".tif"))
        _write_error_map(written[-1], evaluation.map, evaluation.grid, evaluation.system)
    return written


def evaluation_rows(rows: Sequence[Any]) -> tuple[dict[str, Any], ...]:
    """Frozen rows as mappings."""
    return tuple(asdict(row) for row in rows)


def _write_error_map(path: Path, values: NDArray[np.uint8], grid: Raster, system: CoordinateSystem) -> None:
    import rasterio

    from eaves.formats import profile_of, transform_of

    profile = profile_of(grid.shape, transform_of(grid.west, grid.north, grid.cell, system), system)
    with (
        atomic(path) as temporary,
        rasterio.open(temporary, "w", driver="GTiff", dtype="uint8", compress="DEFLATE", **profile) as image,
    ):
        image.write(values, 1)
        image.write_colormap(1, COLOURS)


def _text(value: float | int | str) -> str:
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:.4f}"
    return str(value)


def _json_value(value: Any) -> Any:
    """A value as JSON and CSV hold it: NaN becomes None, mappings and lists are gone through."""
    if isinstance(value, Mapping):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def evaluate_files(
    what: str,
    result: Path,
    reference: Path,
    report: Path | None = None,
    *,
    lod: str | None = None,
    footprints: Path | None = None,
) -> Evaluation:
    """Agreement of a result with a reference, by the field's measures.

    Parameters
    ----------
    what : str
        `ground`, `detection`, `footprints`, `planes` or `models`.
    result, reference : Path
        Clouds (LAS, LAZ, text with labels), label rasters, polygons or CityJSON, as `what` allows.
    report : Path or None
        Folder to write the figures, rows and maps to.
    lod : str or None
        For models: the level of detail; by default the finest of each building.
    footprints : Path or None
        For models against a cloud: the polygons whose roof points count; by default the models' own.

    Returns
    -------
    Evaluation
        The figures, rows and map.

    Raises
    ------
    InputError
        For a file that cannot be read or does not fit `what`.
    ValueError
        For another `what`, and for `lod` or `footprints` with one that takes none.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.evaluate import evaluate_files
    >>> from eaves.simulate import write_simulation
    >>> files = write_simulation(truth, "nine")
    >>> evaluation = evaluate_files("ground", files["points"], files["points"])
    >>> evaluation.figures["total error"]
    0.0
    """
    options = {"lod": lod, "footprints": footprints} if what == "models" else {}
    if not options and (lod or footprints):
        option = "lod" if lod else "footprints"
        raise ValueError(f"{option} is for models only, not for {what}; leave it out")
    if what not in COMPARISONS:
        raise ValueError(f"'{what}' cannot be evaluated; choose one of: {', '.join(COMPARISONS)}")
    comparison = COMPARISONS[what](Path(result), Path(reference), **options)
    evaluation = Evaluation(what, str(result), str(reference), **comparison)
    if report is not None:
        write_report(evaluation, report)
    return evaluation


def compare_ground(result: Path, reference: Path) -> dict[str, Any]:
    """Ground classes of the points both clouds hold, matched by place."""
    judged, true = (read(path) for path in (result, reference))
    same, partner = match_points(judged.xyz + [*judged.origin, 0.0], true.xyz + [*true.origin, 0.0])
    score = evaluate_ground(_ground_classes(judged, result)[partner], _ground_classes(true, reference)[same])
    figures = {
        "points": score.points,
        "points without a partner": int((~same).sum()),
        "type I error": score.type_1,
        "type II error": score.type_2,
        "total error": score.total_error,
        "kappa": score.kappa,
        "F1": score.f1,
    }
    return {"figures": figures}


def compare_detection(result: Path, reference: Path) -> dict[str, Any]:
    """Label images of two sets of buildings."""
    true = open_buildings(reference)
    judged = open_buildings(result, true.system)
    grid = common_grid(judged, true)
    labels, _ = judged.label_image(grid)
    truth, certain = true.label_image(grid)
    score = evaluate_detection(labels, truth, grid.cell, certain)
    figures = {
        **_figures("area", score.area),
        **_figures("objects", score.objects),
        **{
            name: value
            for limit, agreement in score.objects_over.items()
            for name, value in _figures(f"objects over {limit:g} m²", agreement).items()
        },
        **{f"relation {name}": count for name, count in score.relations.items()},
        "RMS of outlines (m)": score.rms_m,
    }
    rows = evaluation_rows(score.rows)
    return {"figures": figures, "rows": rows, "map": score.map, "grid": grid, "system": true.system}


def compare_footprints(result: Path, reference: Path) -> dict[str, Any]:
    """Polygons against polygons."""
    true = open_buildings(reference)
    judged = open_buildings(result, true.system)
    for path, source in ((result, judged), (reference, true)):
        if source.raster is not None or source.cloud is not None:
            raise InputError.about(
                path, "holds no polygons", "give GeoPackage, GeoJSON, shapefile or CityJSON"
            )
    score = evaluate_footprints(judged.polygons, true.polygons, judged.ids, true.ids)
    figures = {
        **_figures("area", score.area),
        "footprints": score.results,
        "reference polygons": score.references,
        "pairs": score.pairs,
        "mean IoU of pairs": score.mean_iou,
        "RMS of outlines (m)": score.rms_m,
        "median Hausdorff distance (m)": score.median_hausdorff_m,
        "mean PoLiS distance (m)": score.mean_polis_m,
        "vertices to one of the reference": score.vertex_ratio,
        **{f"relation {name}": count for name, count in score.relations.items()},
        "mean IoU of united groups": score.mean_iou_united,
        "RMS of outlines of united groups (m)": score.rms_united_m,
    }
    rows = evaluation_rows(score.rows)
    return {"figures": figures, "rows": rows, "shapes": true.polygons, "system": true.system}


def compare_planes(result: Path, reference: Path) -> dict[str, Any]:
    """Roof planes of city models or polygons as label images with heights, or plane numbers of points."""
    if kind_of(result) == kind_of(reference) == "cloud":
        score = evaluate_planes(*pair_points(read_labelled_points(result), read_labelled_points(reference)))
    else:
        judged, true = open_buildings(result), open_buildings(reference)
        grid = common_grid(judged, true, CELL)
        (labels, height), (truth, true_height) = (_planes(path, grid) for path in (result, reference))
        heights = (height, true_height) if height is not None and true_height is not None else (None, None)
        score = evaluate_planes(labels, truth, grid.cell**2, *heights)
    figures = {
        **_figures("planes", score.planes),
        **_figures("planes over 10 m²", score.planes_over_10),
        **{f"relation {name}": count for name, count in score.relations.items()},
        "RMS in plan (m)": score.rms_xy_m,
        "RMS in height (m)": score.rms_z_m,
    }
    return {"figures": figures, "rows": evaluation_rows(score.rows)}


def compare_models(result: Path, reference: Path, lod: str | None, footprints: Path | None) -> dict[str, Any]:
    """Models against a classified cloud, or against reference models."""
    models = read_buildings(result, lod)
    findings = validate_file(result)
    truth = read_buildings(reference) if kind_of(reference) == "city" else []
    cloud = None if truth else read(reference)
    points = lay_points(truth) if cloud is None else _building_points(cloud, reference)
    if footprints is not None:
        shapes, ids, _, _ = read_polygons(footprints, target=None if cloud is None else cloud.system)
        places = dict(zip(ids, shapes, strict=True))
    else:
        places = {item.id: item.footprint for item in truth or models if not item.footprint.is_empty}
    score = evaluate_models(models, points, places, findings, truth, masked=cloud is not None)
    figures = {
        "buildings with roof points": score.buildings,
        "roof points": score.roof_points,
        "missed": score.missed,
        "median distance (m)": score.median_m,
        "median vertical distance (m)": score.median_vertical_m,
        **{f"within {limit:g} m": share for limit, share in score.within.items()},
        "RMSE by building, mean (m)": score.rmse_mean_m,
        "RMSE by building, median (m)": score.rmse_median_m,
        "RMSE of the nearest 95 %, mean (m)": score.rmse95_mean_m,
        "RMSE of the nearest 95 %, median (m)": score.rmse95_median_m,
        "models": score.models,
        "buildings without a model": score.without_model,
        "faces per model": score.faces_per_building,
        "roof faces": score.roof_faces,
        **{f"models at LoD {name}": count for name, count in score.lods.items()},
        "invalid models": score.invalid,
        **{f"finding {code}": count for code, count in score.findings.items()},
        "volume error": score.volume_error,
        "height error (m)": score.height_error_m,
    }
    system = models[0].system if models else LOCAL_METRES
    rows = evaluation_rows(score.rows)
    return {"figures": figures, "rows": rows, "shapes": tuple(places.values()), "system": system}


COMPARISONS: dict[str, Callable[..., dict[str, Any]]] = {
    "ground": compare_ground,
    "detection": compare_detection,
    "footprints": compare_footprints,
    "planes": compare_planes,
    "models": compare_models,
}
"""The fields of an `Evaluation` of two files, by what is compared."""


def _figures(name: str, agreement: Agreement) -> dict[str, float]:
    return {
        f"{name}, completeness": agreement.completeness,
        f"{name}, correctness": agreement.correctness,
        f"{name}, quality": agreement.quality,
    }


def _ground_classes(cloud: PointCloud, path: Path) -> Mask:
    """Ground points: class 2 of LAS, label 0 of text in the manner of the ISPRS filter test."""
    if cloud.classification is None:
        raise InputError.about(path, "has no classes", "give a classified cloud")
    is_text = path.suffix.lower() not in (".las", ".laz")
    filter_test = is_text and set(np.unique(cloud.classification)) <= {0, 1}
    return np.asarray(cloud.classification == (0 if filter_test else GROUND))


def _building_points(cloud: PointCloud, path: Path) -> Values:
    """Points (N, 3) of class 6 in world metres."""
    if cloud.classification is None:
        raise InputError.about(path, "has no classes", "give a cloud with class 6 for buildings")
    return np.asarray(cloud.xyz[cloud.classification == BUILDING] + [*cloud.origin, 0.0])


def _planes(path: Path, grid: Raster) -> tuple[Integers, Values | None]:
    """Plane labels (H, W) of a file, and their heights where it has them."""
    if kind_of(path) == "city":
        origin = (grid.west, grid.north)
        return plane_image(roofs_of(read_buildings(path), origin), grid.with_(west=0.0, north=0.0))
    if kind_of(path) == "raster":
        source = open_buildings(path)
        return source.label_image(grid)[0], None
    if kind_of(path) == "cloud":
        remedy = "compare two clouds with plane_id, or CityJSON or polygons"
        raise InputError.about(path, "is a cloud and the other file is none", remedy)
    with checked_vector(path) as (safe, _):
        layers = [str(name) for name, _ in pyogrio.list_layers(safe)]
    polygons: Shapes = read_polygons(path, "roof_planes" if "roof_planes" in layers else None)[0]
    return burn_labels(polygons, grid), None


PLANE_ID = "plane_id"

SAME_POINT = 0.02
"""Points this near (m) are one point of two files."""


LabelledPoints = tuple[Points, Integers]
"""World coordinates (N, 3) in the file's units, and plane numbers (N,), 0 for none."""


def read_labelled_points(path: Path) -> LabelledPoints:
    """The points of a LAS or LAZ file with the extra dimension `plane_id`."""
    try:
        las = laspy.read(path)
    except (OSError, ValueError, laspy.errors.LaspyException) as error:
        raise InputError.about(path, f"cannot be read ({error})", "give LAS or LAZ") from None
    if PLANE_ID not in set(las.point_format.extra_dimension_names):
        raise InputError.about(
            path, f"has no dimension '{PLANE_ID}'", "give classified.laz of a run, or a simulated scan"
        )
    return np.asarray(las.xyz, np.float64), np.asarray(las[PLANE_ID], np.int64)


def pair_points(result: LabelledPoints, reference: LabelledPoints) -> tuple[Integers, Integers, float]:
    """Plane numbers (N,) of result and reference at the reference's points, and the area (m²) of a point.

    A point the result lacks has no plane there.
    """
    (xyz, planes), (places, true) = result, reference
    matched, partner = match_points(xyz, places)
    plane = np.zeros(len(places), np.int64)
    plane[matched] = planes[partner]
    return plane, true, measure_spacing(places[true > 0] - places[:1]) ** 2


def match_points(result: Points, reference: Points) -> tuple[Mask, Integers]:
    """Mask (N,) of the points of a reference (N, 3) in a result (M, 3), and the number (K,) of each in the
    result."""
    if len(result) == 0 or len(reference) == 0:
        return np.zeros(len(reference), bool), np.zeros(0, np.int64)
    origin = reference.min(axis=0)
    away, which = cKDTree(result - origin).query(reference - origin, distance_upper_bound=SAME_POINT)
    matched = np.isfinite(away)
    return matched, np.asarray(which)[matched]
