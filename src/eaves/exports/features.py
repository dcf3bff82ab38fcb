"""Attributes of many buildings in one glTF mesh: EXT_mesh_features and EXT_structural_metadata."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eaves.exports.glb import ARRAY_BUFFER, FLOAT, GlbParts, Json
from eaves.formats import column_of

EXTENSIONS = ["EXT_mesh_features", "EXT_structural_metadata"]
NO_NUMBER = -9999.0
"""Stands for a missing number, and is declared as such: the format has no null."""
CLASS = "building"


def add_feature_numbers(parts: GlbParts, primitive: Json, numbers: np.ndarray[Any, Any], count: int) -> Json:
    """The primitive with the building's number (K,) of every vertex; `count` buildings there are."""
    data = numbers.astype("<f4").tobytes()
    view = parts.write("features", data, byteStride=4, target=ARRAY_BUFFER)
    attribute = parts.accessor(view, 0, len(numbers), "SCALAR", FLOAT)
    features = [{"featureCount": count, "attribute": 0, "propertyTable": 0}]
    return {
        **primitive,
        "attributes": primitive["attributes"] | {"_FEATURE_ID_0": attribute},
        "extensions": {"EXT_mesh_features": {"featureIds": features}},
    }


def add_property_table(parts: GlbParts, rows: Sequence[Mapping[str, Any]]) -> Json:
    """The document's extension: one row a building, numbers as FLOAT64, all else as text."""
    schema: dict[str, Json] = {}
    table: dict[str, Json] = {}
    for title in dict.fromkeys(title for row in rows for title in row):
        name = re.sub(r"\W", "_", title, flags=re.ASCII)
        name = f"_{name}" if name[:1].isdigit() or not name else name
        values, missing = column_of([row.get(title) for row in rows])
        if values.dtype.kind in "if":
            numbers = np.where(missing, NO_NUMBER, values).astype("<f8")
            schema[name] = {"type": "SCALAR", "componentType": "FLOAT64", "noData": NO_NUMBER}
            table[name] = {"values": parts.write(f"column-{name}", numbers.tobytes())[0]}
        else:
            shown = ("" if gone else str(value) for value, gone in zip(values, missing, strict=True))
            texts = [text.encode() for text in shown]
            ends = np.cumsum([0, *map(len, texts)]).astype("<u4")
            schema[name] = {"type": "STRING", "noData": ""}
            table[name] = {
                "values": parts.write(f"column-{name}", b"".join(texts) or b"\0")[0],
                "stringOffsets": parts.write(f"ends-{name}", ends.tobytes())[0],
                "stringOffsetType": "UINT32",
            }
        schema[name]["name"] = title
    described = {"id": "eaves", "classes": {CLASS: {"properties": schema}}}
    filled = {"class": CLASS, "count": len(rows), "properties": table}
    return {"EXT_structural_metadata": {"schema": described, "propertyTables": [filled]}}
