"""The maps whose layouts are known: which columns tell them, what names a building, whose work they are.

Layouts are recognised by their columns alone, whatever the file is named. Column names are compared without
regard to case: shapefiles and databases change it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from eaves.formats.vectors.polygons import text_of

Attributes = Mapping[str, Any]
ATTRIBUTION = "attribution"
"""Attribute of every footprint of a known map: whose work it is, under which licence."""


@dataclass(frozen=True)
class Layout:
    """A map's layout. Names of columns are in lower case, alternatives in the order of preference."""

    name: str
    """The name in `--footprint-source`."""
    title: str
    holder: str
    """Who is to be named where the data, or what is made from them, are shown."""
    licence: str
    marks: tuple[frozenset[str], ...]
    """A layer has this layout when it has all columns of one of these sets …"""
    alone: tuple[frozenset[str], ...] = ()
    """… or those of one of these and no others."""
    id_fields: tuple[str, ...] = ()
    id_width: int | None = None
    """Digits of an id that is a number: leading zeros are lost where files hold it as one."""
    kind: tuple[str, ...] = ()
    """A column without which a polygon is no building; none where all are buildings."""
    superseded: tuple[str, ...] = ()
    """A column that is filled in versions that are no longer true."""
    gone: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Values (in lower case) by column that say that nothing stands there."""
    street: tuple[str, ...] = ()
    """Columns of an address that go before the comma …"""
    place: tuple[str, ...] = ()
    """… and behind it."""
    said: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Columns of what all maps may say, by the name it is given: year_built, use, storeys, map_height_m."""
    folded: str | None = None
    """A column that holds further columns as text, `"key"=>"value"`."""

    @property
    def attribution(self) -> str:
        """The line that goes with the data."""
        return f"{self.holder} ({self.title}), {self.licence}"


def marks(*sets: str) -> tuple[frozenset[str], ...]:
    """Sets of columns, each as words of a text."""
    return tuple(frozenset(text.split()) for text in sets)


def values(*texts: str) -> frozenset[str]:
    """Values of a column, in lower case."""
    return frozenset(text.lower() for text in texts)


LAYOUTS = (
    Layout(
        name="bag",
        title="BAG",
        holder="Kadaster",
        licence="CC0 1.0",
        marks=marks(
            "identificatie bouwjaar status aantal_verblijfsobjecten",
            "identificatie bouwjaar status rdf_seealso",
            "identificatie oorspronkelijkbouwjaar status",
            "identificatie oorspronkelijk_bouwjaar status",
        ),
        id_fields=("identificatie",),
        id_width=16,
        superseded=("eindgeldigheid", "eind_geldigheid"),
        gone={
            "status": values(
                "Pand gesloopt",
                "Niet gerealiseerd pand",
                "Bouwvergunning verleend",
                "Pand ten onrechte opgevoerd",
            )
        },
        said={
            "year_built": ("bouwjaar", "oorspronkelijkbouwjaar", "oorspronkelijk_bouwjaar"),
            "use": ("gebruiksdoel",),
        },
    ),
    Layout(
        name="bgt",
        title="BGT",
        holder="Kadaster",
        licence="CC0 1.0",
        marks=marks(
            "identificatie_bag_pnd relatieve_hoogteligging",
            "identificatiebagpnd relatievehoogteligging",
            "identificatie_bag_pnd bgt_status",
            "identificatiebagpnd bgt_status",
            "identificatiebagpnd bgt-status",
        ),
        id_fields=(
            *("identificatie_lokaal_id", "identificatielokaalid", "lokaal_id", "lokaalid"),
            *("identificatie.lokaalid", "gml_id"),
        ),
        superseded=("eind_registratie", "eindregistratie", "objecteindtijd", "termination_date"),
        gone={
            "bgt_status": values("plan", "historie"),
            "bgt-status": values("plan", "historie"),
            "relatieve_hoogteligging": values("-1", "-2", "-3", "-4", "-5"),
            "relatievehoogteligging": values("-1", "-2", "-3", "-4", "-5"),
        },
    ),
    Layout(
        name="bdtopo",
        title="BD TOPO",
        holder="IGN",
        licence="Licence Ouverte / Etalab 2.0",
        marks=marks(
            "cleabs usage_1 etat_de_l_objet construction_legere",
            "cleabs usage_1 nombre_d_etages",
            "id usage1 leger nb_etages",
            "id usage1 etat hauteur z_min_sol",
        ),
        id_fields=("cleabs", "id"),
        gone={
            "etat_de_l_objet": values("En projet", "Détruit", "Non retrouvé"),
            "etat": values("En projet", "Détruit", "Non retrouvé"),
        },
        said={
            "use": ("usage_1", "usage1"),
            "storeys": ("nombre_d_etages", "nb_etages"),
            "map_height_m": ("hauteur",),
        },
    ),
    Layout(
        name="usa-structures",
        title="USA Structures",
        holder="FEMA and Oak Ridge National Laboratory",
        licence="CC BY 4.0",
        marks=marks("build_id occ_cls", "uuid occ_cls prim_occ", "build_id prop_addr"),
        id_fields=("uuid", "build_id"),
        street=("prop_addr",),
        place=("prop_city", "prop_st", "prop_zip"),
        said={"use": ("prim_occ", "occ_cls"), "map_height_m": ("height",)},
    ),
    Layout(
        name="overture",
        title="Overture Maps",
        holder="OpenStreetMap contributors, Overture Maps Foundation",
        licence="ODbL 1.0",
        marks=marks(
            "id version sources subtype class has_parts",
            "id sources has_parts is_underground",
            "id sources num_floors roof_shape facade_material",
        ),
        id_fields=("id",),
        gone={"is_underground": values("true", "1")},
        said={"use": ("class", "subtype"), "storeys": ("num_floors",), "map_height_m": ("height",)},
    ),
    Layout(
        name="osm",
        title="OpenStreetMap",
        holder="OpenStreetMap contributors",
        licence="ODbL 1.0",
        marks=marks(
            "osm_id building",
            "osm_id fclass type code",
            "@id building",
            "osmid building",
            "full_id osm_type building",
            "osm_way_id building",
            "id building element",
            "id building addr:housenumber",
        ),
        id_fields=("full_id", "@id", "osm_id", "osmid", "osm_way_id", "id"),
        kind=("building", "fclass"),
        gone={
            "building": values("no", "demolished", "proposed"),
            "location": values("underground"),
            "demolished:building": values("yes"),
        },
        street=("addr:street", "addr:housenumber"),
        place=("addr:postcode", "addr:city"),
        said={
            "year_built": ("start_date",),
            "use": ("building:use", "type", "building"),
            "storeys": ("building:levels",),
            "map_height_m": ("height",),
        },
        folded="other_tags",
    ),
    Layout(
        name="microsoft",
        title="Microsoft Building Footprints",
        holder="Microsoft",
        licence="ODbL 1.0",
        marks=marks("release capture_dates_range"),
        alone=marks("height confidence"),
        said={"map_height_m": ("height",)},
    ),
)
"""The layouts, those recognised by more columns first: the first that fits is taken."""
NO_SOURCE = "none"
"""The value of `--footprint-source` for polygons that are to be taken as they are."""
SOURCE_NAMES = (*(layout.name for layout in LAYOUTS), NO_SOURCE)


def layout_of(columns: Sequence[str]) -> Layout | None:
    """The layout of a layer with these columns; None where it is none that is known."""
    names = {column.lower() for column in columns}
    for layout in LAYOUTS:
        if any(mark <= names for mark in layout.marks) or names in layout.alone:
            return layout
    return None


@dataclass(frozen=True, eq=False)
class Reader:
    """The rows of one layer as a layout reads them."""

    layout: Layout
    columns: Mapping[str, str]
    """The layer's columns by their names in lower case."""

    @classmethod
    def of(cls, layout: Layout, columns: Sequence[str]) -> Reader:
        """The reader of a layer with these columns."""
        return cls(layout, {column.lower(): column for column in columns})

    def value(self, row: Attributes, names: Sequence[str]) -> str:
        """The first of the columns that is filled in, as text; empty where none is."""
        folded = None
        for name in names:
            column = self.columns.get(name)
            if column is not None:
                text = text_of(row.get(column))
            else:
                folded = self.unfolded(row) if folded is None else folded
                text = folded.get(name, "")
            if text:
                return text
        return ""

    def unfolded(self, row: Attributes) -> dict[str, str]:
        """The columns that one column holds as text."""
        column = self.columns.get(self.layout.folded or "")
        text = "" if column is None else text_of(row.get(column))
        return {key.lower(): entry for key, entry in re.findall(r'"([^"]+)"\s*=>\s*"([^"]*)"', text)}

    def id_of(self, row: Attributes) -> str:
        """The building's id; empty where it has none."""
        text = self.value(row, self.layout.id_fields)
        return text.zfill(self.layout.id_width or 0) if text.isdigit() else text

    def is_current_building(self, row: Attributes) -> bool:
        """True if the polygon is a building, in a version that is still valid."""
        kinds = [name for name in self.layout.kind if name in self.columns]
        if kinds and not self.value(row, kinds):
            return False
        return not self.value(row, [name for name in self.layout.superseded if name in self.columns])

    def absence(self, row: Attributes) -> str:
        """Why nothing stands there, as the map says it: `status Pand gesloopt`; empty where it does not."""
        for name, gone in self.layout.gone.items():
            text = self.value(row, [name])
            if text.lower() in gone:
                return f"{name} {text}"
        return ""

    def attributes(self, row: Attributes) -> dict[str, Any]:
        """The row with what the layout adds: attribution, address, year, use, storeys, height.

        What the row says under one of these names stays.
        """
        added: dict[str, Any] = {ATTRIBUTION: self.layout.attribution}
        street = " ".join(filter(None, (self.value(row, [name]) for name in self.layout.street)))
        place = " ".join(filter(None, (self.value(row, [name]) for name in self.layout.place)))
        if street:
            added["address"] = ", ".join(filter(None, (street, place)))
        for name, columns in self.layout.said.items():
            text = self.value(row, columns)
            entry = text if name == "use" else number_of(text)
            if entry not in (None, ""):
                added[name] = entry
        return {**row, **{name: value for name, value in added.items() if name not in self.columns}}


def number_of(text: str) -> int | float | None:
    """The number a text begins with, whole where it is; None for none, and for -1 and 0, which maps write for
    what they do not know."""
    match = re.match(r"[+-]?\d+(\.\d+)?", text)
    if match is None or float(match[0]) <= 0.0:
        return None
    number = float(match[0])
    return int(number) if number.is_integer() else number
