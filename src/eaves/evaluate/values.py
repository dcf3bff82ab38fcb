"""The measures for values in memory: tables, polygons, clouds, masks, results of runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eaves.evaluate.detection_scores import DetectionScore, common_grid, evaluate_detection, open_buildings
from eaves.evaluate.footprint_scores import FootprintScore, evaluate_footprints
from eaves.evaluate.matching import GroundScore, evaluate_ground
from eaves.evaluate.report import Evaluation, evaluate_files
from eaves.flow import MODELS, ModelledBuildings, Results
from eaves.formats import as_point_files, as_polygon_file, read, read_polygons, write_cityjson_seq
from eaves.model import Mask, PointCloud


def footprints(result: Any, reference: Any) -> FootprintScore:
    """Scores of footprints against reference polygons.

    Parameters
    ----------
    result, reference : GeoDataFrame, GeoSeries, polygons or path
        The result is brought to the system of the reference.

    Returns
    -------
    FootprintScore
        As `evaluate_footprints` gives it, in metres.

    Raises
    ------
    TypeError
        When a value holds no polygons.
    InputError
        When a file cannot be read.

    Examples
    --------
    >>> import shapely
    >>> import eaves
    >>> eaves.evaluate.footprints([shapely.box(0, 0, 10, 9)], [shapely.box(0, 0, 10, 10)]).mean_iou
    0.9
    """
    with as_polygon_file(result, "result") as judged_path, as_polygon_file(reference, "reference") as path:
        true, true_ids, _, system = read_polygons(Path(path))
        shapes, ids, _, _ = read_polygons(Path(judged_path), target=system)
    return evaluate_footprints(shapes, true, ids, true_ids)


def ground(result: Mask | PointCloud | str | Path, reference: Mask | PointCloud | str | Path) -> GroundScore:
    """Scores of the ground of the same points in the same order.

    Parameters
    ----------
    result, reference : ndarray (N,) of bool, PointCloud or path
        Masks, or clouds with classes, or files of them.

    Returns
    -------
    GroundScore
        As `evaluate_ground` gives it.

    Raises
    ------
    ValueError
        When a cloud has no classes, or the numbers of points differ.
    InputError
        When a file cannot be read.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> eaves.evaluate.ground(eaves.classify_ground(truth.cloud), truth.classified()).total_error < 0.05
    True
    """
    clouds = (read(one) if isinstance(one, str | Path) else one for one in (result, reference))
    masks = [one.ground if isinstance(one, PointCloud) else np.asarray(one) for one in clouds]
    return evaluate_ground(*masks)


def detection(result: Any, reference: Any) -> DetectionScore:
    """Scores of buildings against reference polygons, by area and by object.

    Parameters
    ----------
    result, reference : GeoDataFrame, GeoSeries, polygons or path
        The result is brought to the system of the reference; paths may be what `evaluate_files` takes.

    Returns
    -------
    DetectionScore
        As `evaluate_detection` gives it, on cells of 0.5 m.

    Raises
    ------
    TypeError
        When a value holds no polygons.
    InputError
        When a file cannot be read.

    Examples
    --------
    >>> import shapely
    >>> import eaves
    >>> score = eaves.evaluate.detection([shapely.box(0, 0, 10, 9)], [shapely.box(0, 0, 10, 10)])
    >>> score.area.correctness
    1.0
    """
    with as_polygon_file(result, "result") as judged_path, as_polygon_file(reference, "reference") as path:
        true = open_buildings(Path(path))
        judged = open_buildings(Path(judged_path), true.system)
    grid = common_grid(judged, true)
    truth, known = true.label_image(grid)
    return evaluate_detection(judged.label_image(grid)[0], truth, grid.cell, known)


def roofs(
    result: str | Path | Results | ModelledBuildings, reference: Any, lod: str | None = None
) -> Evaluation:
    """Agreement of models with points, or with other models.

    Parameters
    ----------
    result : Results, ModelledBuildings or path
        What `build`, `find_buildings` or `model_buildings` returned, or CityJSON.
    reference : Results, ModelledBuildings, PointCloud, laspy.LasData or path
        Other models, or points that are classified.
    lod : str or None
        Level of detail; by default the finest of each building.

    Returns
    -------
    Evaluation
        The figures and rows of `evaluate_files`.

    Raises
    ------
    InputError
        When a file cannot be read.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> cloud = nine_roofs_on_a_slope(density=4.0).classified()
    >>> found = eaves.find_buildings(cloud)
    >>> eaves.evaluate.roofs(found, cloud).figures["models"]
    9
    """
    with as_models_file(result) as judged, as_models_file(reference) as true:
        return evaluate_files("models", judged, true, lod=lod)


@contextmanager
def as_models_file(given: Any) -> Iterator[Path]:
    """The file of models or points that a value names, or one, until the block ends, that holds them."""
    if isinstance(given, Results):
        yield given.folder / MODELS
    elif isinstance(given, ModelledBuildings):
        with TemporaryDirectory(prefix="eaves-") as folder:
            write_cityjson_seq(path := Path(folder) / MODELS, given.models, given.system)
            yield path
    else:
        with as_point_files(given) as path:
            yield Path(path)
