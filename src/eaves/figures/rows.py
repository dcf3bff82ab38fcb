"""Attribute rows of buildings and roof faces, as the GeoPackage, the report and the summary show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import rotate

from eaves.figures.party_walls import envelope_figures
from eaves.geometry.face_table import FaceTable
from eaves.model import OVERHANGS, ROOF_SURFACE, BuildingModel, Failure

HIGH, LOW = 0.75, 0.4
"""Least probability that a building is right for high, and for medium trust."""

WEIGHTS = {
    "one": 1.67,
    "off": -5.59,
    "empty": -2.96,
    "corners": -1.51,
    "hidden": -5.12,
    "notched": -1.91,
    "unsteady": -5.61,
}
"""Of the traits in the log-odds that a building is right; from `python -m benchmarks.accuracy.trust`."""

HOUSE = float(np.log(4.0 / np.sqrt(100.0)))
"""The corners for the size of a plain house of 100 m²."""

DETAILED = "2.2"
"""At this level the whole roof is modelled; why there is no finer one says nothing of the roof."""

LEAST_LOSS = 0.7
"""Log-odds that a trait must cost to be a reason: half of the odds."""

DEFECT_LOSS = WEIGHTS["one"] + WEIGHTS["corners"] * HOUSE - float(np.log(HIGH / (1.0 - HIGH)))
"""Log-odds that a trait must cost to take a plain house out of high trust by itself."""

UNSEEN_SHARE = 0.25
"""Share of the plan without points from which a model is a guess: whole faces hide in it."""

BLANK_SHARE = 0.08
"""Share of the outline beside which nothing at all was seen, from which the building may go on there."""

HIDDEN_LEVELS = 0.03
"""Share of its height by which a level roof may be off, as what was not seen may be of another level."""

POOR_FIT_M = 0.3
"""RMSE (m) over which the points do not show the roof that is drawn: ten times the noise of a common scan."""

NO_ROOF = "no_roof"
"""The `fallback_code` of a given outline whose points are none of a roof."""

SEEN_FROM_AFAR = ("interpolated", "nearest ground")
"""Sources of a base that no ground beside the building shows."""

CELLS = "surface raster"
"""Source of a base, where points are cells of a DSM."""


VEHICLE_WIDTH_M, VEHICLE_HEIGHT_M, VEHICLE_LENGTH_M = (2.55, 2.95), (2.2, 5.0), (7.5, 18.0)
"""Trailers and containers are 2.44 to 2.6 m wide, 2.6 to 4.2 m high and to 16.2 m long; outlines and tops
are as much as a step of the scan larger, the ground beside lower. Shorter ones are as large as garages."""

TRAILER_HEIGHT_M, TRAILER_LENGTH_M = 3.8, 13.0
"""Least height and length (m) of trailers that stand side by side."""

VEHICLE_BADNESS = 0.9
"""How likely what has the form of a vehicle is none of a building's."""

NO_ROOF_BADNESS = 0.9
"""How likely a model is wrong whose points are a crown's, a hedge's or the ground's."""


MANUAL = "manual"
"""The trust of a building that a person edited or confirmed."""


def is_vehicle(row: Mapping[str, Any]) -> bool:
    """True for a level top that has the width, height and length of a trailer or container, or the height and
    length of trailers and the width of several side by side."""
    width, length, height = (row.get(name) or 0.0 for name in ("width_m", "length_m", "measuredHeight"))
    (least, most), (lowest, highest) = VEHICLE_WIDTH_M, VEHICLE_HEIGHT_M
    if row.get("roof_type") != "flat" or not lowest <= height <= highest or length > VEHICLE_LENGTH_M[1]:
        return False
    if width <= most:
        return bool(length >= VEHICLE_LENGTH_M[0])
    abreast = width / most <= width // least
    return bool(abreast and height >= TRAILER_HEIGHT_M and length >= TRAILER_LENGTH_M)


def trust_traits(row: Mapping[str, Any]) -> NDArray[np.float64]:
    """The traits (7,) that `WEIGHTS` weigh: 1, share of the roof points that are not near the roof,
    share without data, logarithm of the corners over the root of the area, share of the outline beside which
    no ground was seen, share of the least rectangle around it that is not filled, and how far it disagrees
    with the outlines drawn through half of its boundary points.

    An outline that was given is not judged: it counts as a sure rectangle in sight, of the size of a house.
    """
    inlier_share, corners, box, agreement = (
        row.get(name) for name in ("inlier_share", "corners", "box_share", "outline_agreement")
    )
    return np.array(
        [
            1.0,
            0.0 if inlier_share is None else 1.0 - inlier_share,
            row.get("share_no_data") or 0.0,
            HOUSE if corners is None else np.log(corners / np.sqrt(max(row["area_m2"], 1.0))),
            row.get("hidden_share") or 0.0,
            0.0 if box is None else 1.0 - box,
            0.0 if agreement is None else 1.0 - agreement,
        ]
    )


def trait_gains(row: Mapping[str, Any]) -> dict[str, float]:
    """The log-odds that each trait gives."""
    gains = trust_traits(row) * np.array(list(WEIGHTS.values()))
    return dict(zip(WEIGHTS, gains.tolist(), strict=True))


def lacks_model(row: Mapping[str, Any]) -> bool:
    """True for a building without a model."""
    return row.get("lod") in (None, "0") and bool(row.get("failure_code"))


def is_unsupported(row: Mapping[str, Any]) -> bool:
    """True for a roof of which too little is supported by its points for high trust."""
    supported = row.get("supported_share")
    return supported is not None and bool(supported < HIGH)


def hides_levels(row: Mapping[str, Any]) -> bool:
    """True for a level roof of several levels, where what has no points may be of either of them."""
    if row.get("roof_type") != "flat" or row.get("h_eaves") is None or row.get("h_ground") is None:
        return False
    step, high = row["h_ridge"] - row["h_eaves"], row["h_ridge"] - row["h_ground"]
    return bool((row.get("share_no_data") or 0.0) * step > HIDDEN_LEVELS * high)


def has_defect(row: Mapping[str, Any]) -> bool:
    """True if a fault that a person can see takes a building out of high trust by itself. A party wall under
    one roof, of which the scan shows nothing, is none.
    """
    gains = trait_gains(row)
    return (
        is_unsupported(row)
        or any(gains[name] <= -DEFECT_LOSS for name in WORDS)
        or any(doubts_of({**row, "wall_certainty": None}))
    )


def judge(row: Mapping[str, Any]) -> tuple[str, float, str]:
    """The class of trust of a building (high, medium, low; manual where a person set it), how likely it is
    wrong (0 to 1), and the reasons in words.

    Right is a building of which nine tenths of the plan lie within 0.2 m of the true roof, and nine tenths of
    the outline within 1 m of the true one, and the other way round. What towns of which everything is known
    do not show lowers the class by itself: a roof that its points do not support,
    a coarser model, an uncertain party wall, a base that no ground beside the building shows, a quarter of
    the plan without points, points far off the roof on the whole, a roof that rises over its points, an
    outline beside which nothing was seen.

    Examples
    --------
    >>> from eaves.figures.rows import judge
    >>> judge({"lod": "2.2", "score": 1.0, "supported_share": 0.3})[0]
    'low'
    """
    if lacks_model(row):
        return "low", 1.0, f"no model: {row.get('failure_reason')}"
    gains = trait_gains(row)
    badness = float(1.0 / (1.0 + np.exp(sum(gains.values()))))
    reasons = []
    if is_unsupported(row):
        badness = max(badness, 1.0 - row["supported_share"])
        reasons.append(f"{1.0 - row['supported_share']:.0%} of the roof is not supported by its points")
    weak_traits = [name for name, gain in gains.items() if name in WORDS and gain <= -LEAST_LOSS]
    reasons += [WORDS[name].format(**row) for name in sorted(weak_traits, key=lambda name: gains[name])]
    doubts = list(doubts_of(row))
    if row.get("failure_code") == NO_ROOF:
        badness = max(badness, NO_ROOF_BADNESS)
    if is_vehicle(row):
        badness = max(badness, VEHICLE_BADNESS)
        reasons.insert(0, "a container or vehicle? level, {width_m:.1f} by {length_m:.1f} m".format(**row))
    if doubts:
        badness = max(badness, 1.0 - 0.5 * (HIGH + LOW))
    trust = "high" if 1.0 - badness >= HIGH else "medium" if 1.0 - badness > LOW else "low"
    trust = MANUAL if row.get("edit") else trust
    return trust, badness, "; ".join(dict.fromkeys([*reasons, *doubts]) or [SMALL_DOUBTS] * (trust != "high"))


WORDS = {
    "off": "only {inlier_share:.0%} of its points lie within 0.2 m of the roof",
    "empty": "{share_no_data:.0%} of its plan has no points",
    "corners": "{corners} corners on {area_m2:.0f} m²",
    "hidden": "no ground was seen beside {hidden_share:.0%} of its outline",
    "unsteady": "outlines through half of its boundary points agree with it by {outline_agreement:.0%} only",
}
"""The fault that a trait shows, in words. That an outline is no rectangle is none."""

SMALL_DOUBTS = "no single reason: points off the roof, gaps in the points and its outline together"


def doubts_of(row: Mapping[str, Any]) -> Iterator[str]:
    """The reasons that lower the trust by themselves, in words."""
    if row.get("failure_code") and str(row.get("lod")) < DETAILED:
        yield f"coarser than LoD 2.2: {row.get('failure_reason')}"
    if (row.get("share_no_data") or 0.0) >= UNSEEN_SHARE:
        yield WORDS["empty"].format(**row)
    elif hides_levels(row):
        yield "it has several levels, and {share_no_data:.0%} of its plan has no points".format(**row)
    if (row.get("blank_share") or 0.0) >= BLANK_SHARE:
        yield "nothing was seen beside {blank_share:.0%} of its outline: it may go on there".format(**row)
    if (row.get("rmse_m") or 0.0) > POOR_FIT_M:
        yield f"its points lie {row['rmse_m']:.2f} m (RMSE) off the roof"
    if row.get("over_points_m"):
        yield f"its roof rises {row['over_points_m']:.2f} m over its highest point"
    wall = row.get("wall_certainty")
    if wall is not None and wall < LOW:
        yield f"a party wall of certainty {wall:.2f}"
    if row.get("ground_source") == CELLS:
        yield "its points are cells of a raster, which shows no wall and nothing under trees"
    if row.get("ground_source") in SEEN_FROM_AFAR:
        far = row.get("ground_distance_m")
        base = "is interpolated" if far is None else f"is that of ground {far} m away"
        yield f"no ground was seen beside it: its base {base}"


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
