"""Building models as CityGML 2.0 and 3.0, written building by building.

CityGML counts levels by whole numbers: LoD 0 is the footprint, LoD 1 the finest of 1.3 and 1.2, LoD 2 that of
2.3, 2.2 and 2.0. A level of several solids becomes parts, as in CityJSON, and what stands on a roof is a
BuildingInstallation with its body at LoD 2. Coordinates stand in the order of axes that the authority of the
named system has, northing first in many. The faces of LoD 2 stand once, as
RoofSurface, WallSurface, GroundSurface and OuterCeilingSurface; the solid refers to them. Attributes are
generic ones, those that the standard knows (`roofType`, `measuredHeight`, `storeysAboveGround`) its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, islice
from pathlib import Path
from typing import Any, TextIO
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from shapely import Polygon

from eaves.formats import (
    Format,
    atomic,
    attributes_of,
    clean,
    installation_figures,
    parse_crs,
    plane_part,
    reference_system,
)
from eaves.model import (
    LOCAL_METRES,
    NO_PLANE,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Footprint,
    Points,
    Provenance,
    Solid,
)

DECIMALS = 4
"""Of a coordinate: a tenth of a millimetre, or of a thousandth of a foot."""
STANDARD = ("roofType", "measuredHeight", "storeysAboveGround")
"""Attributes of the standard's own."""
KINDS = {float: "double", int: "int"}
"""Type of a value → kind of its generic attribute; of any other it is `string`."""
LEVELS = {"1": ("1.3", "1.2"), "2": ("2.3", "2.2", "2.0")}
"""CityGML's level → level of detail here, the finest first."""

EAST_NORTH_UP = [0, 1, 2]
"""The order of axes within this package."""

Result = BuildingModel | Failure


@dataclass(frozen=True)
class Version:
    """The names that differ between the two versions."""

    name: str
    spaces: Mapping[str, str]
    surface: str
    """Prefix of RoofSurface and its kin."""
    boundary: str
    """The property that holds them."""
    geometry: str
    """Prefix of a level's geometry."""
    footprint: str
    part: str
    installation: str


CITYGML_2 = Version(
    "2.0",
    {
        "core": "http://www.opengis.net/citygml/2.0",
        "bldg": "http://www.opengis.net/citygml/building/2.0",
        "gen": "http://www.opengis.net/citygml/generics/2.0",
        "gml": "http://www.opengis.net/gml",
        "xlink": "http://www.w3.org/1999/xlink",
    },
    surface="bldg",
    boundary="bldg:boundedBy",
    geometry="bldg",
    footprint="bldg:lod0FootPrint",
    part="bldg:consistsOfBuildingPart",
    installation="bldg:outerBuildingInstallation",
)
CITYGML_3 = Version(
    "3.0",
    {
        "core": "http://www.opengis.net/citygml/3.0",
        "con": "http://www.opengis.net/citygml/construction/3.0",
        "bldg": "http://www.opengis.net/citygml/building/3.0",
        "gen": "http://www.opengis.net/citygml/generics/3.0",
        "gml": "http://www.opengis.net/gml/3.2",
        "xlink": "http://www.w3.org/1999/xlink",
    },
    surface="con",
    boundary="core:boundary",
    geometry="core",
    footprint="core:lod0MultiSurface",
    part="bldg:buildingPart",
    installation="bldg:buildingInstallation",
)


def write_citygml(
    path: str | Path,
    models: Iterable[Result],
    system: CoordinateSystem = LOCAL_METRES,
    version: Version = CITYGML_2,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write one building after the other (`.gml`); return their number.

    Parameters
    ----------
    path : str or Path
        The file; it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one. A Failure that knows its
        footprint is written with LoD 0 and the attributes `failure_code` and `failure_reason`.
    system : CoordinateSystem
        Coordinate system the coordinates are written in.
    version : Version
        `CITYGML_2` or `CITYGML_3`.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings written.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.exports import write_citygml
    >>> write_citygml("nine.gml", models)
    9
    """
    count = 0
    url = reference_system(system)
    place = f" srsName={quoteattr(url)}" if url else ""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with atomic(path) as temporary:
        body = temporary.with_suffix(".body")  # the extent stands first and is known last
        with body.open("w", encoding="utf-8", newline="\n") as file:
            for result in models:
                if result.footprint is None:
                    continue
                count += 1
                writer = _GmlBuilding(
                    file, result, result.footprint, system, version, place, f"building-{count}"
                )
                writer.write()
                low, high = np.minimum(low, writer.low), np.maximum(high, writer.high)
        with (
            temporary.open("w", encoding="utf-8", newline="\n") as file,
            body.open(encoding="utf-8") as parts,
        ):
            names = " ".join(f'xmlns:{prefix}="{space}"' for prefix, space in version.spaces.items())
            file.write(f'<?xml version="1.0" encoding="UTF-8"?>\n<core:CityModel {names}>\n')
            if provenance:
                file.write(f"<gml:description>{escape(provenance.sentence)}</gml:description>\n")
            if count:
                corners = "".join(
                    f"<gml:{name}>{listed}</gml:{name}>"
                    for name, listed in zip(
                        ("lowerCorner", "upperCorner"), position_texts(np.array([low, high])), strict=True
                    )
                )
                box = f'<gml:Envelope{place} srsDimension="3">{corners}</gml:Envelope>'
                file.write(f"<gml:boundedBy>{box}</gml:boundedBy>\n")
            while piece := parts.read(1 << 20):
                file.write(piece)
            file.write("</core:CityModel>\n")
        body.unlink()
    return count


write_citygml3 = partial(write_citygml, version=CITYGML_3)
"""`write_citygml` of version 3.0."""


@cache
def axes_of(system: CoordinateSystem) -> list[int]:
    """The axes (of east, north, up) in the order in which a system's authority lists them: a URL as
    `srsName` says that coordinates follow it (OGC 09-048r5), and readers exchange them where it does not
    begin with the easting. What WKT of the input says of its axes does not count."""
    if system.code is None:
        return EAST_NORTH_UP
    plane = plane_part(parse_crs(system.code.split("+")[0]))
    return [1, 0, 2] if plane.axis_info[0].direction == "north" else EAST_NORTH_UP


def position_texts(points: Points) -> list[str]:
    """The coordinates of each of the points (N, 3)."""
    row = f"%.{DECIMALS}f %.{DECIMALS}f %.{DECIMALS}f\n"
    return (row * len(points) % tuple(points.ravel().tolist())).splitlines()


@cache
def generic_tags(version: str, name: str, kind: str) -> tuple[str, str]:
    """What stands before and behind the value of a generic attribute of a kind, as a version has it."""
    if version == CITYGML_2.name:
        return f"<gen:{kind}Attribute name={quoteattr(name)}>", f"</gen:{kind}Attribute>"
    tag = f"gen:{kind.capitalize()}Attribute"
    begin = f"<core:genericAttribute><{tag}><gen:name>{escape(name)}</gen:name>"
    return begin, f"</{tag}></core:genericAttribute>"


def xml_name(text: str) -> str:
    """An id as XML allows it; two ids never become one: what is not allowed is written as its number."""
    name = text.replace("_x", "_x5f_x")
    name = re.sub(r"[^\w.-]", lambda found: f"_x{ord(found[0]):x}_", name, flags=re.ASCII)
    return name if name[:1].isalpha() or name[:1] == "_" else f"_x_{name}"


def flat_face(polygon: Polygon, height: float) -> Solid:
    """A polygon at a height (m) as one face that looks up."""
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (polygon.exterior, *polygon.interiors)]
    plan = np.concatenate([ring if polygon.exterior.is_ccw else ring[::-1] for ring in rings])
    vertices = np.column_stack([plan, np.full(len(plan), height)])
    sizes, count = np.array([len(ring) for ring in rings]), np.array([len(rings)])
    return Solid(vertices, np.arange(len(plan)), sizes, count, np.array([""]), np.array([NO_PLANE]))


class _GmlBuilding:
    """Writes one building; `low` and `high` are its extent then."""

    def __init__(
        self,
        file: TextIO,
        result: Result,
        footprint: Footprint,
        system: CoordinateSystem,
        version: Version,
        place: str,
        name: str,
    ) -> None:
        self.file, self.result, self.footprint, self.version, self.place = (
            file,
            result,
            footprint,
            version,
            place,
        )
        self.identifier = xml_name(footprint.id or name)
        self.origin, self.unit = np.array([*footprint.origin, 0.0]), np.array(system.unit_m)
        self.axes = axes_of(system)
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.attributes = clean(attributes_of(result))
        self.polygons = 0

    def write(self) -> None:
        """The whole member."""
        solids = self.result.solids if isinstance(self.result, BuildingModel) else {}
        chosen = {
            level: next((solids[lod] for lod in names if lod in solids), ())
            for level, names in LEVELS.items()
        }
        bottoms = [solid.vertices[:, 2].min() for parts in solids.values() for solid in parts]
        base = min(bottoms) if bottoms else float(self.attributes.get("h_ground") or 0.0)
        whole = {level: parts[0] for level, parts in chosen.items() if len(parts) == 1}
        several = {level: parts for level, parts in chosen.items() if len(parts) > 1}
        parts = [
            {level: parts[number] for level, parts in several.items() if number < len(parts)}
            for number in range(max(map(len, several.values()), default=0))
        ]
        objects = self.result.installations if isinstance(self.result, BuildingModel) else ()
        written = [*whole.values(), *(one.solid for one in objects), *chain(*map(dict.values, parts))]
        self.faces = self._faces([flat_face(self.footprint.polygon, base), *written])
        self.file.write(f'<core:cityObjectMember><bldg:Building gml:id="{self.identifier}">\n')
        self.file.write(f"<gml:name>{escape(self.footprint.id)}</gml:name>\n" if self.footprint.id else "")
        self.file.writelines(self._generic(self.attributes))
        height = self.attributes.get("measuredHeight")
        if self.version is CITYGML_2:
            self.file.write(self._known("roofType"))
            if height is not None:
                self.file.write(f'<bldg:measuredHeight uom="m">{float(height):.3f}</bldg:measuredHeight>\n')
            self.file.write(self._known("storeysAboveGround"))
        self._geometry(whole, base, height)
        for number, part in enumerate(parts, 1):
            name = f"{self.identifier}-{number}"
            self.file.write(f'<{self.version.part}><bldg:BuildingPart gml:id="{name}">\n')
            self._geometry(part, None, None)
            self.file.write(f"</bldg:BuildingPart></{self.version.part}>\n")
        self.file.write("</bldg:Building></core:cityObjectMember>\n")

    def _known(self, name: str) -> str:
        """An attribute that the standard knows by this name."""
        value = self.attributes.get(name)
        return "" if value is None else f"<bldg:{name}>{escape(str(value))}</bldg:{name}>\n"

    def _installations(self) -> Iterator[str]:
        """What stands on the roofs, each with its function and its body."""
        objects = self.result.installations if isinstance(self.result, BuildingModel) else ()
        for number, one in enumerate(objects, 1):
            function = f"<bldg:function>{escape(one.kind)}</bldg:function>"
            body = self._closed(self._shell(one.solid))
            content = f"{function}<bldg:lod2Geometry>{body}</bldg:lod2Geometry>"
            if self.version is CITYGML_3:
                content = f"<core:lod2Solid>{body}</core:lod2Solid>{function}"
            name, tag = f"{self.identifier}-i{number}", self.version.installation
            yield (
                f'<{tag}><bldg:BuildingInstallation gml:id="{name}">'
                f"{''.join(self._generic(clean(installation_figures(one))))}{content}"
                f"</bldg:BuildingInstallation></{tag}>\n"
            )

    def _generic(self, attributes: Mapping[str, Any]) -> Iterator[str]:
        """Attributes, as the version has generic ones."""
        for name, value in attributes.items():
            if value is None or name in STANDARD or isinstance(value, list | dict):
                continue
            text = escape(str(value).lower() if isinstance(value, bool) else str(value))
            begin, end = generic_tags(self.version.name, name, KINDS.get(type(value), "string"))
            yield f"{begin}<gen:value>{text}</gen:value>{end}\n"

    def _geometry(self, solids: Mapping[str, Solid], base: float | None, height: Any) -> None:
        """The footprint, where `base` says how high it lies, and the solids, each version in its order."""
        pieces: dict[str, str] = {}
        if base is not None:
            flat = self._multi([self._polygon(next(self.faces))[1]])
            pieces["0"] = f"<{self.version.footprint}>{flat}</{self.version.footprint}>\n"
        surfaces = ""
        for level, solid in solids.items():
            if level == "2":
                surfaces, shell = self._surfaces(solid)
            else:
                shell = self._shell(solid)
            tag = f"{self.version.geometry}:lod{level}Solid"
            pieces[level] = f"<{tag}>{self._closed(shell)}</{tag}>\n"
        ordered = [pieces[level] for level in sorted(pieces)]
        on_roofs = self._installations() if base is not None else ()  # of the building, not of a part
        if self.version is CITYGML_2:
            self.file.writelines([*ordered, *on_roofs, surfaces])
            return
        self.file.writelines([surfaces, *ordered])
        if height is not None:
            self.file.write(
                "<con:height><con:Height><con:highReference>highestRoofEdge</con:highReference>"
                "<con:lowReference>lowestGroundPoint</con:lowReference><con:status>measured</con:status>"
                f'<con:value uom="m">{float(height):.3f}</con:value></con:Height></con:height>\n'
            )
        if base is not None:
            self.file.write(self._known("roofType") + self._known("storeysAboveGround"))
        self.file.writelines(on_roofs)

    def _shell(self, solid: Solid) -> str:
        """The faces of a solid as surface members."""
        faces = (self._polygon(rings)[1] for rings in islice(self.faces, len(solid.surfaces)))
        return "".join(f"<gml:surfaceMember>{face}</gml:surfaceMember>" for face in faces)

    def _closed(self, shell: str) -> str:
        """A solid of surface members: GML 3.1 wraps them as a composite surface, GML 3.2 as a shell."""
        wrap = "CompositeSurface" if self.version is CITYGML_2 else "Shell"
        identity = "" if self.version is CITYGML_2 else f' gml:id="{self._next()}"'
        outside = f"<gml:exterior><gml:{wrap}>{shell}</gml:{wrap}></gml:exterior>"
        return f"<gml:Solid{identity}{self.place}>{outside}</gml:Solid>"

    def _surfaces(self, solid: Solid) -> tuple[str, str]:
        """The bounding surfaces of LoD 2, one a face, and the references of the solid to them."""
        made, references = [], []
        for surface in solid.surfaces.tolist():
            name, polygon = self._polygon(next(self.faces))
            kind = f"{self.version.surface}:{surface}"
            tag = "bldg:lod2MultiSurface" if self.version is CITYGML_2 else "core:lod2MultiSurface"
            made.append(
                f'<{self.version.boundary}><{kind} gml:id="{name}-surface">'
                f"<{tag}>{self._multi([polygon])}</{tag}></{kind}></{self.version.boundary}>\n"
            )
            references.append(f'<gml:surfaceMember xlink:href="#{name}"/>')
        return "".join(made), "".join(references)

    def _multi(self, polygons: Iterable[str]) -> str:
        members = "".join(f"<gml:surfaceMember>{polygon}</gml:surfaceMember>" for polygon in polygons)
        identity = "" if self.version is CITYGML_2 else f' gml:id="{self._next()}"'
        return f"<gml:MultiSurface{identity}{self.place}>{members}</gml:MultiSurface>"

    def _faces(self, solids: Sequence[Solid]) -> Iterator[list[str]]:
        """The coordinates of the rings of each face of solids, in the system's units, in the order in which
        they are written."""
        first = np.cumsum([0, *(len(solid.vertices) for solid in solids)]).tolist()
        corners = np.concatenate([one.corners + start for one, start in zip(solids, first, strict=False)])
        vertices = np.concatenate([solid.vertices for solid in solids])
        world = ((vertices + self.origin) / self.unit)[:, self.axes]
        self.low = world[corners].min(axis=0, initial=np.inf)
        self.high = world[corners].max(axis=0, initial=-np.inf)
        listed = list(map(position_texts(world).__getitem__, corners.tolist()))
        ends = np.cumsum(np.concatenate([solid.ring_sizes for solid in solids])).tolist()
        places = (listed[start:end] for start, end in zip([0, *ends], ends, strict=False))
        rings = (" ".join([*ring, ring[0]]) for ring in places)
        counts = chain.from_iterable(solid.ring_counts.tolist() for solid in solids)
        return (list(islice(rings, count)) for count in counts)

    def _polygon(self, rings: Iterable[str]) -> tuple[str, str]:
        """The id of a polygon, and its XML, of the coordinates of its rings."""
        name = self._next()
        outer, *holes = (
            f'<gml:LinearRing><gml:posList srsDimension="3">{listed}</gml:posList></gml:LinearRing>'
            for listed in rings
        )
        sides = f"<gml:exterior>{outer}</gml:exterior>"
        sides += "".join(f"<gml:interior>{hole}</gml:interior>" for hole in holes)
        return name, f'<gml:Polygon gml:id="{name}">{sides}</gml:Polygon>'

    def _next(self) -> str:
        self.polygons += 1
        return f"{self.identifier}-g{self.polygons}"


FORMAT = Format({"models": ("buildings.gml", write_citygml)})
FORMAT_3 = Format({"models": ("buildings3.gml", write_citygml3)})
