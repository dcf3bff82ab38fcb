"""The report of an evaluation: figures as JSON, rows as CSV and GeoPackage, the map as GeoTIFF."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.formats import atomic
from eaves.model import LOCAL_METRES, CoordinateSystem, Raster

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
