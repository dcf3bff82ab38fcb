"""Attribute rows of buildings and roof faces, as the GeoPackage, the report and the summary show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import rotate

from eaves.figures.party_walls import envelope_figures
from eaves.figures.trust import judge
from eaves.geometry.face_table import FaceTable
from eaves.model import OVERHANGS, ROOF_SURFACE, BuildingModel, Failure

PLACE = ("x_m", "y_m", "orientation_deg", "length_m", "width_m")
"""What of the row of a primitive is its rectangle."""


@dataclass(frozen=True, eq=False)
class BuildingRow:
    """The figures of one building for tables: made with it, for its model takes ten times as long to load."""

    polygon: Polygon
    """The footprint in world metres."""
    values: dict[str, Any]
    given: dict[str, Any]
    """The attributes of the footprint that was given."""
    faces: list[tuple[Polygon, dict[str, Any]]]
    """As `roof_rows` gives them."""
    modelled: bool
    code: str | None
    """Of a failure; of a model the reason why it is coarser than asked for."""
    seconds: Mapping[str, float]
    primitives: Sequence[Mapping[str, Any]] = ()
    """The parameters of each house that it was modelled as, of methods that do (`PRIMITIVES`)."""

    @classmethod
    def of(cls, result: BuildingModel | Failure, seconds: Mapping[str, float]) -> BuildingRow:
        """The columns of one building."""
        footprint = result.footprint
        assert footprint is not None
        row = describe_model(result)
        map_columns = {f"given_{key}": value for key, value in footprint.attributes.items()}
        modelled = isinstance(result, BuildingModel)
        return cls(
            footprint.world,
            row,
            map_columns,
            list(roof_rows(result)),
            modelled,
            row["failure_code"],
            seconds,
            result.attributes.get("primitive_rows", ()) if isinstance(result, BuildingModel) else (),
        )

    def numbered(self, number: int, walls: Mapping[str, float] | None) -> dict[str, Any]:
        """The whole row; `number` is what `building_id` says in the classified points, `walls` the building's
        (`wall_figures`), where known."""
        floors: Mapping[str, Any] = {}
        if walls is not None:
            floors = envelope_figures(walls, self.values, self.polygon.area, self.given.get("given_storeys"))
        return {**self.values, "number": number, **floors, **self.given}


def describe_model(result: BuildingModel | Failure) -> dict[str, Any]:
    """The columns of one building that are known when it is modelled, its trust among them.

    Parameters
    ----------
    result : BuildingModel or Failure
        With its footprint.

    Returns
    -------
    dict
        Column → value, as docs/columns.md lists them: `trust` (high, medium, low), `trust_score` (0 to 1) and
        `review_reason` say how far it can be relied on. `number` is 0: tables number their rows.

    Raises
    ------
    AttributeError
        When it is no building.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> house = nine_roofs_on_a_slope(density=1.0).buildings[0].model()
    >>> eaves.describe_model(house)["lod"]
    '2.2'
    """
    footprint = result.footprint
    assert footprint is not None
    row: dict[str, Any] = {
        "id": footprint.id,
        "number": 0,
        "score": round(float(footprint.score), 3),
        "area_m2": round(float(footprint.polygon.area), 2),
    }
    if not isinstance(result, BuildingModel):
        return row | {"lod": None, "failure_code": result.code, "failure_reason": result.reason}
    row |= {"lod": result.lod, "failure_code": None, "failure_reason": None}
    row |= {key: value for key, value in result.attributes.items() if not isinstance(value, list | dict)}
    row["failure_code"] = row.pop("fallback_code", None)
    row["failure_reason"] = row.pop("fallback_reason", None)
    trust, badness, reason = judge(row)
    return row | {"trust": trust, "trust_score": round(1.0 - badness, 3), "review_reason": reason}


def primitive_rows(rows: Iterable[BuildingRow]) -> Iterator[tuple[Polygon, dict[str, Any]]]:
    """Rectangle (world metres) and attributes of every primitive of buildings that are made of them."""
    for row in rows:
        for one in row.primitives:
            x, y, turn, length, width = (one[f"house_{name}"] for name in PLACE)
            box = shapely.box(x - 0.5 * length, y - 0.5 * width, x + 0.5 * length, y + 0.5 * width)
            yield rotate(box, turn), {"building_id": row.values["id"], **one}


def roof_rows(result: BuildingModel | Failure) -> Iterator[tuple[Polygon, dict[str, Any]]]:
    """Polygon (world metres, with heights) and attributes of every roof face of the finest level."""
    if not isinstance(result, BuildingModel) or not result.solids:
        return
    origin = np.array([*result.footprint.origin, 0.0])
    records = result.attributes.get("roof_faces", ())
    solids = result.solids[result.lod]
    table = FaceTable.of_solids(solids, ROOF_SURFACE)
    planes = np.concatenate([solid.planes[solid.surfaces == ROOF_SURFACE] for solid in solids]).tolist()
    sizes = zip(table.moved(origin).polygons(3), face_figures(table), strict=True)
    for number, (plane, (polygon, figures)) in enumerate(zip(planes, sizes, strict=True)):
        if result.lod == OVERHANGS and 0 <= plane < len(records):
            number = plane  # a slab for each level: the faces come in another order
        record: dict[str, Any] = records[number] if number < len(records) else {}
        share = record.get("share_no_data")
        yield (
            polygon,
            {
                "building_id": result.footprint.id,
                "lod": result.lod,
                **figures,
                "rmse_m": rmse_of(result, plane),
                "points": record.get("points"),
                "share_no_data": None if share is None else round(share, 3),
                "no_data": record.get("no_data"),
                "h_low": rounded(record.get("h_low")),
                "h_high": rounded(record.get("h_high")),
                "h_ground": rounded(result.attributes.get("h_ground")),
                **{key: rounded(record.get(key)) for key in ("inlier_share", "density", "coverage")},
                "weak": record.get("weak"),
            },
        )


def rounded(value: float | None) -> float | None:
    """To three places."""
    return None if value is None else round(float(value), 3)


def rmse_of(model: BuildingModel, plane: int) -> float | None:
    """The RMSE of the points of one of the model's planes, None where a face lies on none of them."""
    return round(model.planes[plane].rmse, 4) if 0 <= plane < len(model.planes) else None


def face_figures(faces: FaceTable) -> Iterator[dict[str, float | None]]:
    """Slope, azimuth (clockwise from grid north, None if flat), sloped and projected area of each face."""
    figures = faces.slopes_deg, faces.azimuths_deg, faces.areas, np.abs(faces.vectors[:, 2])
    for slope, azimuth, area, projected in np.column_stack(figures).tolist():
        yield {
            "slope_deg": round(slope, 2),
            "azimuth_deg": None if np.isnan(azimuth) else round(azimuth, 1),
            "area_m2": round(area, 2),
            "projected_m2": round(projected, 2),
        }
