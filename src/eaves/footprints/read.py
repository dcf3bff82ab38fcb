"""Areas and footprints that the user gives, in world metres: repaired, clipped, named."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.footprints.layouts import NO_SOURCE, SOURCE_NAMES, Layout, Reader, layout_of
from eaves.formats import InputError, read_polygons
from eaves.formats.crs import horizontal_crs
from eaves.formats.transformation import datum_remark
from eaves.formats.vectors.polygons import DEGREES, list_vector_layers, placing_remedy, read_table, text_of
from eaves.formats.vectors.vector_files import VectorLayer
from eaves.geometry.rings import COORDINATE_STEP, half_shared, polygon_parts
from eaves.model import Bounds, CoordinateSystem, Failure, Footprint

log = logging.getLogger("eaves")
BUILDING_WORDS = re.compile(
    "buil[dt]|bldg|footprint|structure|house|gebouw|pand|geb(ä|ae|a)ud|h(ä|ae)user|bauwerk|b(a|â)ti|immeuble|"
    "edif|constru|fabbric|bud[oy][vwn]|byg[gn]|rakennu|[eé]p[uü]let|cl[aă]dir|zgrad|stavb|bina|hoone|здан|будів|"
    "сград|建物|建筑|κτ[ιί]ρ",
    re.IGNORECASE,
)
"""How names of layers begin words for buildings, in the languages of public maps."""


def in_metres(bounds: Bounds | None, system: CoordinateSystem) -> Bounds | None:
    """Bounds given in the system's unit, in metres."""
    if bounds is None:
        return None
    unit = system.horizontal_unit_m
    return Bounds(bounds.west * unit, bounds.south * unit, bounds.east * unit, bounds.north * unit)


def read_area(path: Path, system: CoordinateSystem) -> BaseGeometry:
    """The union of a file's polygons, prepared for many questions."""
    area = shapely.union_all(shapely.make_valid(read_polygons(path, target=system)[0]))
    shapely.prepare(area)
    return area


def shift_of(path: Path, system: CoordinateSystem) -> str | None:
    """The remark on a change of datum between a file of polygons and the points for which PROJ lacks the
    grid; None where there is none."""
    target, layers = horizontal_crs(system), list_vector_layers(path) if path.exists() else []
    given = next((layer.crs for layer in layers if layer.crs), None)
    if target is None or given is None:
        return None
    return datum_remark(path.name, given, target.to_wkt())


def area_of(boxes: NDArray[np.float64], bounds: Bounds | None, clip: BaseGeometry | None) -> BaseGeometry:
    """Area in which footprints are used: the rectangle around the boxes (F, 4) of all files that have points,
    within `bounds` and `clip`.

    Not the union of the boxes: between those of neighbouring files are gaps of a point spacing, which would
    cut the footprints that cross them.
    """
    if not len(boxes):
        return shapely.Polygon()
    area: BaseGeometry = shapely.box(*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0))
    for limit in (None if bounds is None else as_box(bounds), clip):
        if limit is not None:
            area = shapely.intersection(area, limit)
    return area


def as_box(bounds: Bounds) -> shapely.Polygon:
    """Bounds as a polygon."""
    return shapely.box(bounds.west, bounds.south, bounds.east, bounds.north)


@dataclass(frozen=True)
class Map:
    """A layer of a vector file whose layout is known."""

    layout: Layout
    layer: VectorLayer
    addresses: str | None = None
    """A layer of the same file with the addresses of its buildings."""

    def describe(self) -> dict[str, str]:
        """The facts of it in run.json."""
        return {
            "source": self.layout.name,
            "layer": self.layer.name,
            "attribution": self.layout.attribution,
        }


def recognise_map(path: Path, source: str | None = None, layer: str | None = None) -> Map | None:
    """The layer of a file that has a known layout; None where none has.

    Parameters
    ----------
    path : Path
        The vector file.
    source : str or None
        Name of the layout it must have, or `none` to look for no layout.
    layer : str or None
        The one layer that is looked at.

    Raises
    ------
    InputError
        When the name is unknown, the file has no layer of this layout, or several and none alone is named as
        buildings are.
    """
    if source is not None and source not in SOURCE_NAMES:
        choices = ", ".join(SOURCE_NAMES)
        raise InputError(f"--footprint-source {source}: unknown source; choose one of: {choices}")
    if source == NO_SOURCE or not path.exists():
        return None
    layers = list_vector_layers(path)
    shapes = [one for one in layers if one.kind and "Point" not in one.kind and layer in (None, one.name)]
    known = [one for one in shapes if (layout := layout_of(one.columns)) and source in (None, layout.name)]
    if known:
        chosen = sole_layer(path, known)
        layout = layout_of(chosen.columns)
        assert layout is not None
        address_layers = [
            table.name for table in layers if layout.name == "bag" and address_columns(table.columns)
        ]
        return Map(layout, chosen, next(iter(address_layers), None))
    if source is not None:
        rule = f"has no layer with the columns of {source}"
        raise InputError.about(path, rule, "leave --footprint-source out, or give `none`")
    return None


def polygon_layer(path: Path, layer: str | None) -> str | None:
    """The layer asked for, else the one of several layers of polygons that is of buildings; None where that
    is the first one, or the file leaves no choice."""
    if layer is not None or not path.exists():
        return layer
    layers = list_vector_layers(path)
    polygons = [one for one in layers if "Polygon" in one.kind or "Surface" in one.kind]
    polygons = polygons or [one for one in layers if one.kind in ("Unknown", "GeometryCollection")]
    name = sole_layer(path, polygons).name if len(polygons) > 1 else None
    return None if polygons and name == polygons[0].name else name


def sole_layer(path: Path, layers: Sequence[VectorLayer]) -> VectorLayer:
    """The only layer with features, or the only one of these whose name says buildings.

    Raises
    ------
    InputError
        When there are several, with all names.
    """
    filled = [one for one in layers if one.count] or list(layers)
    named = [one for one in filled if BUILDING_WORDS.search(one.name)] if len(filled) > 1 else filled
    if len(named) != 1:
        names = ", ".join(f"'{one.name}'" for one in named or filled)
        rule = f"has {len(named or filled)} layers of polygons that may be the buildings: {names}"
        raise InputError.about(path, rule, "choose one with --layer NAME")
    if len(layers) > 1:
        log.info("%s: layer '%s' of %d is read; --layer names another", path, named[0].name, len(layers))
    return named[0]


def read_footprints(
    path: Path,
    id_field: str | None,
    system: CoordinateSystem,
    area: BaseGeometry,
    source: Map | None = None,
    may_miss: bool = True,
    layer: str | None = None,
) -> tuple[list[Footprint], list[Failure]]:
    """The footprints of a file, repaired and clipped to `area`, and a failure, with what is known of the
    footprint, for each that cannot be used: none is lost.

    Of a map whose layout is `source`, which may be that of a country, only what meets the area is read, of
    another one the `layer`, or the one that is of buildings.

    Raises
    ------
    InputError
        When `id_field` leaves a footprint without an id, or gives two the same, or no polygon meets the area
        and none `may_miss` it, or several layers may be the buildings.
    """
    if source is None:
        layer = polygon_layer(path, layer)
        shapes, ids, attributes, _ = read_polygons(path, layer, id_field, system, keep_all=True)
        if id_field is None:
            ids = found_ids(path, ids, attributes)
    else:
        shapes, ids, attributes = read_map(path, id_field, system, area, source)
    if not may_miss:
        refuse_apart(path, shapes, area, system)
    if id_field is not None:
        refuse_ids(path, id_field, [row[id_field] for row in attributes])
    footprints, unusable = usable_and_not(repair_footprints(shapes, ids, attributes))
    absent: list[Failure] = []
    if source is not None:
        footprints, absent = without_absent(footprints, source)
    parts = [footprint for footprint in footprints if footprint.attributes.get(PART, 1) > 1]
    if parts:
        log.warning(
            "%s: footprints of several parts give a row for each part, the first: '%s'", path, parts[0].id
        )
    inside, outside = usable_and_not(clip_footprints(footprints, area))
    outside = outside if source is None else []  # of a country's map nobody asks for what lies elsewhere
    for failures in (unusable, absent, outside):
        if failures:
            log.warning(
                "%s: %d footprints cannot be modelled, the first: %s", path, len(failures), failures[0].reason
            )
    return inside, [*unusable, *absent, *outside]


def refuse_apart(
    path: Path, shapes: Sequence[BaseGeometry], area: BaseGeometry, system: CoordinateSystem
) -> None:
    """Check that the box of a shape (world metres) meets that of the area.

    Raises
    ------
    InputError
        With where the shapes lie, and where the points.
    """
    boxes = shapely.bounds(np.array(shapes, dtype=object)).reshape(-1, 4)
    boxes = boxes[~np.isnan(boxes).any(axis=1)]
    if shapely.intersects(shapely.box(*boxes.T), area.envelope).any():
        return
    unplaced = bool(len(boxes)) and all(layer.crs is None for layer in list_vector_layers(path))
    if unplaced and (np.abs(boxes) <= DEGREES * system.horizontal_unit_m).all():
        rule = "has no coordinate system, and its numbers look like degrees"
        raise InputError.about(path, rule, placing_remedy(path, "EPSG:4326"))
    place = f"they lie within {box_text(boxes, system)}" if len(boxes) else "none is near them"
    rule = f"no polygon meets the points: {place}, the points within {box_text([area.bounds], system)}"
    if unplaced:
        raise InputError.about(path, f"has no coordinate system, and {rule}", placing_remedy(path))
    raise InputError.about(path, rule, "check its coordinate system, give another map, or add --allow-empty")


def box_text(boxes: ArrayLike, system: CoordinateSystem) -> str:
    """West, south, east and north of boxes (N, 4) (m) in the unit of a system, as `--bounds` takes them."""
    extents = np.asarray(boxes).reshape(-1, 4) / system.horizontal_unit_m
    sides = (*extents[:, :2].min(axis=0), *extents[:, 2:].max(axis=0))
    return ",".join(f"{side:.0f}" for side in sides)


def usable_and_not(results: Sequence[Footprint | Failure]) -> tuple[list[Footprint], list[Failure]]:
    """The footprints among some answers, and the failures."""
    usable = [result for result in results if isinstance(result, Footprint)]
    return usable, [result for result in results if isinstance(result, Failure)]


def read_map(
    path: Path, id_field: str | None, system: CoordinateSystem, area: BaseGeometry, source: Map
) -> tuple[list[BaseGeometry], list[str], list[dict[str, Any]]]:
    """Shapes, ids and attributes of a map's buildings that meet the area; one line says what was read."""
    reader = Reader.of(source.layout, source.layer.columns)
    within = None if area.is_empty else Bounds(*area.bounds)
    shapes, numbers, rows, _ = read_polygons(path, source.layer.name, target=system, within=within)
    touching = shapely.intersects(area, shapely.make_valid(np.array(shapes, dtype=object)))
    current = [n for n in np.flatnonzero(touching) if reader.is_current_building(rows[n])]
    name = id_field or next((field for field in source.layout.id_fields if field in reader.columns), None)
    ids = [text_of(rows[n][id_field]) if id_field else reader.id_of(rows[n]) for n in current]
    ids = [identifier or numbers[n] for n, identifier in zip(current, ids, strict=True)]
    addresses = addresses_of(path, source.addresses, set(ids), source.layout.id_width or 0)
    attributes = [
        reader.attributes(rows[n]) | addresses.get(identifier, {})
        for n, identifier in zip(current, ids, strict=True)
    ]
    log.info(
        "%s: read as %s (layer %s, ids %s), %s of %s polygons are buildings near the points; %s",
        *(path, source.layout.title, source.layer.name, "numbered" if name is None else f"from {name}"),
        *(f"{len(current):,}", f"{source.layer.count:,}", source.layout.attribution),
    )
    return [shapes[n] for n in current], ids, attributes


def without_absent(footprints: list[Footprint], source: Map) -> tuple[list[Footprint], list[Failure]]:
    """The footprints of what stands, and a failure for each of which the map says that nothing does."""
    reader = Reader.of(source.layout, source.layer.columns)
    standing, absent = [], []
    for footprint in footprints:
        reason = reader.absence(footprint.attributes)
        if not reason:
            standing.append(footprint)
            continue
        message = f"nothing stands there, says {source.layout.title}: {reason}"
        absent.append(Failure("not_standing", message, "outline", footprint))
    return standing, absent


DOUBLED = "doubled"
"""Code of the failure of a given footprint of which half or more lies in another one."""


def without_doubled(footprints: Sequence[Footprint]) -> tuple[list[Footprint], list[Failure]]:
    """The footprints that stand on ground of their own, in their order, and a failure for each that shares
    half of itself or more with a larger one of these, or with an earlier one as large: a building that a map
    holds twice is modelled once."""
    polygons = [footprint.polygon for footprint in footprints]
    beside: dict[int, list[int]] = {}
    for _, number, other in half_shared(polygons, polygons):
        if number != other:
            beside.setdefault(number, []).append(other)
    rank = sorted(beside, key=lambda number: (-round(polygons[number].area, 3), number))
    places = {number: place for place, number in enumerate(rank)}
    over: dict[int, int] = {}
    for number in rank:
        larger = [other for other in beside[number] if places[other] < places[number] and other not in over]
        if larger:
            over[number] = min(larger, key=places.__getitem__)
    failures = [
        Failure(
            DOUBLED,
            f"half of it or more lies in the footprint '{footprints[k].id}'",
            "outline",
            footprints[n],
        )
        for n, k in sorted(over.items())
    ]
    return [footprint for n, footprint in enumerate(footprints) if n not in over], failures


ADDRESS_COLUMNS: tuple[tuple[str, ...], ...] = (
    ("pand_identificatie", "pandidentificatie"),
    ("openbare_ruimte_naam", "openbare_ruimte", "openbareruimte"),
    ("huisnummer",),
    ("huisletter",),
    ("toevoeging", "huisnummertoevoeging"),
    ("postcode",),
    ("woonplaats_naam", "woonplaats"),
)
"""Columns of the BAG's addressable objects: the building's id, street, number, letter, addition, postcode,
town."""
ADDRESSES_SHOWN = 3
"""Maximum number of addresses listed for a building; of more, their number is given."""


def address_columns(columns: Sequence[str]) -> list[str | None]:
    """Columns of a layer that are those of `ADDRESS_COLUMNS`; none without a building's id, street or
    number."""
    by_name = {column.lower(): column for column in columns}
    matches = [next((by_name[name] for name in names if name in by_name), None) for names in ADDRESS_COLUMNS]
    return matches if None not in matches[:3] else []


def addresses_of(path: Path, layer: str | None, ids: set[str], width: int) -> dict[str, dict[str, Any]]:
    """The addresses of the buildings `ids`, by id: `address` in words, `addresses` their number."""
    if layer is None or not ids:
        return {}
    columns = next(table.columns for table in list_vector_layers(path) if table.name == layer)
    names = address_columns(columns)
    by_building: dict[str, set[tuple[str, int, str, str]]] = {}
    for row in read_table(path, layer, [name for name in names if name is not None]):
        values = ["" if name is None else text_of(row[name]) for name in names]
        street, number, letter, addition, postcode, town = values[1:]
        house = number + letter + (f"-{addition}" if addition else "")
        place = " ".join(filter(None, (postcode, town)))
        address = (street, int(number) if number.isdigit() else 0, house, place)
        for identifier in values[0].split(","):  # an object may lie in several buildings
            building = identifier.strip().zfill(width)
            if building in ids:
                by_building.setdefault(building, set()).add(address)
    texts = {}
    for identifier, addresses in by_building.items():
        lines = [
            f"{street} {house}" + (f", {place}" if place else "")
            for street, _, house, place in sorted(addresses)
        ]
        more = f" and {len(lines) - ADDRESSES_SHOWN} more" if len(lines) > ADDRESSES_SHOWN else ""
        texts[identifier] = {"address": "; ".join(lines[:ADDRESSES_SHOWN]) + more, "addresses": len(lines)}
    return texts


def found_ids(path: Path, numbers: list[str], attributes: Sequence[Mapping[str, Any]]) -> list[str]:
    """The ids in the one column that has "id" in its name and another value in each row, else the numbers; a
    line says which."""
    columns = {name: [row.get(name) for row in attributes] for name in (attributes[0] if attributes else ())}
    named = [name for name in columns if re.search(r"(^|[^a-z])id([^a-z]|$)|ident", name.lower())]
    unique = [name for name in named if len(set(map(text_of, columns[name])) - {""}) == len(numbers)]
    if len(unique) == 1:
        log.info("%s: ids from the field '%s'; --id-field names another", path, unique[0])
        return list(map(text_of, columns[unique[0]]))
    if named:
        log.warning("%s: footprints are numbered; --id-field names one of: %s", path, ", ".join(named))
    return numbers


def refuse_ids(path: Path, id_field: str, ids: Sequence[object]) -> None:
    """Refuse footprints that share an id.

    Raises
    ------
    InputError
        With how many have none, or which one occurs more than once.
    """
    remedy = f"fix the field, name another one, or leave --id-field {id_field} out: then they are numbered"
    empty = sum(value is None or str(value).strip() == "" for value in ids)
    if empty:
        raise InputError.about(path, f"{empty} of {len(ids)} footprints have no '{id_field}'", remedy)
    often = [name for name, count in Counter(map(text_of, ids)).items() if count > 1]
    if often:
        rule = f"{len(often)} values of '{id_field}' occur more than once (the first: '{often[0]}')"
        raise InputError.about(path, rule, remedy)


MOST_CORNERS = 3000
"""No building has more; lines and checks of all corners with all others would take hours of a million."""
COARSEST = 1.0
"""No corner is moved so far (m) to have fewer: what has more even so has as many courtyards."""
PART = "given_part"
"""Attribute of what a footprint of several parts becomes: 1 for the largest, which keeps the id."""
MIN_AREA_M2 = 1.0
"""A given footprint, or a part of one, that is smaller is a slip of the pen."""


def repair_footprints(
    shapes: Iterable[BaseGeometry | None],
    ids: Sequence[str] | None = None,
    attributes: Sequence[Mapping[str, Any]] | None = None,
) -> list[Footprint | Failure]:
    """The usable footprints among `shapes` (metres), in their order: valid, single, counter-clockwise; a
    Failure, with a footprint that has id and attributes but no area, for each that has none to build on.

    A shape of several parts, or one that crosses itself, becomes several footprints, the largest first; all
    but the first get "-2", "-3", … behind the id. So does an id that was given before.
    """
    results: list[Footprint | Failure] = []
    names: set[str] = set()
    other_ids = set() if ids is None else set(map(str, ids))
    for number, shape in enumerate(shapes):
        identifier = "" if ids is None else str(ids[number])
        columns = {} if attributes is None else dict(attributes[number])
        parts = repaired_parts(shape)
        for place, part in enumerate(parts, 1):
            name = unused_id(identifier, names | other_ids if place > 1 else names)
            names.add(name)
            several = {PART: place} if len(parts) > 1 else {}
            results.append(Footprint(part, id=name, attributes=columns | several))
        if not parts:
            name = str(number) if ids is None else identifier
            reason = f"given footprint '{name}' {defect_of(shape)}"
            nowhere = Footprint(Polygon(), id=name, attributes=columns)
            results.append(Failure("no_area", reason, "outline", nowhere))
    return results


def defect_of(shape: BaseGeometry | None) -> str:
    """Why there is nothing to build on in a shape, in words."""
    if shape is None or shape.is_empty:
        return "has no geometry"
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        return "has coordinates that are no numbers"
    return f"is a {shape.geom_type} without area"


def repaired_parts(shape: BaseGeometry | None) -> list[Polygon]:
    """The valid polygons of a shape, largest first, without parts and holes under `MIN_AREA_M2`."""
    if shape is None or shape.is_empty or not np.isfinite(shapely.get_coordinates(shape)).all():
        return []
    parts = []
    for polygon in polygon_parts(shapely.force_2d(shape), COORDINATE_STEP):
        part = lightened(polygon)
        if part.area >= MIN_AREA_M2:
            holes = [ring for ring in part.interiors if Polygon(ring).area >= MIN_AREA_M2]
            parts.append(shapely.orient_polygons(Polygon(part.exterior, holes)))
    return sorted(parts, key=lambda part: (-part.area, part.bounds))


def lightened(part: Polygon) -> Polygon:
    """The polygon; of more corners than `MOST_CORNERS` fewer, true to a millimetre, or to the least
    power of two of it that leaves no more."""
    tolerance, light = COORDINATE_STEP, part
    while shapely.get_num_coordinates(light) > MOST_CORNERS and tolerance < COARSEST:
        light = shapely.simplify(part, tolerance)
        tolerance *= 2
    return light


def unused_id(stem: str, names: set[str]) -> str:
    """The id, or the first of id-2, id-3, … not in `names`; an empty one stays empty."""
    name, number = stem, 1
    while name and name in names:
        number += 1
        name = f"{stem}-{number}"
    return name


def clip_footprints(
    footprints: Sequence[Footprint], area: Bounds | BaseGeometry
) -> list[Footprint | Failure]:
    """Each footprint cut to `area`, in order; a Failure for those outside; what was cut carries `clipped`.

    Of a footprint that the border cuts into several pieces the largest stays.
    """
    if isinstance(area, Bounds):
        area = shapely.box(area.west, area.south, area.east, area.north)
    results: list[Footprint | Failure] = []
    shapely.prepare(area)
    for footprint in footprints:
        if area.contains_properly(footprint.polygon):
            results.append(footprint)
            continue
        inside = repaired_parts(footprint.polygon.intersection(area))
        if not inside:
            reason = f"given footprint '{footprint.id}' lies outside the area"
            results.append(Failure("outside", reason, "outline", footprint))
        elif inside[0].area > footprint.polygon.area - MIN_AREA_M2 * COORDINATE_STEP:
            results.append(footprint)
        else:
            marked = {**footprint.attributes, "clipped": True}
            results.append(footprint.with_(polygon=inside[0], attributes=marked))
    return results
