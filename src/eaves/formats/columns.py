"""The columns of the tables: title, unit, meaning. Maps, plug-ins and schemas are made from it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A column of a table; `unit` is empty for counts, names and shares, `kind` is the type of its values."""

    title: str
    unit: str
    meaning: str
    kind: type = float

    @property
    def label(self) -> str:
        """The title with the unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


MONTHS = (
    *("January", "February", "March", "April", "May", "June", "July"),
    *("August", "September", "October", "November", "December"),
)
HOUSE = (
    ("x", "m", "Middle of the house, x", "in metres, also where coordinates are in feet"),
    ("y", "m", "Middle of the house, y", "in metres, also where coordinates are in feet"),
    ("orientation", "deg", "Axis of the house", "of the ridge, counter-clockwise from the x axis, 0 to 180"),
    ("length", "m", "Length of the house", "along the ridge"),
    ("width", "m", "Width of the house", "across the ridge"),
    ("eaves", "m", "Eaves of the house", "above the datum"),
    ("ridge", "m", "Ridge of the house", "above the datum"),
    ("slope", "deg", "Slope of the house", "of its roof, mean of both sides"),
)
"""The parameters of a house, each as it stands, in closed form, and with its standard deviation."""
COLUMNS: dict[str, Column] = {
    "id": Column("Building", "", "id of the building, the same in every run", str),
    "number": Column("Number", "", "what building_id says in the classified points", int),
    "version": Column("Version", "", "how often an update has modelled the building; empty for once", int),
    "creationDate": Column("Creation date", "", "of the version, by the update that made it", str),
    "score": Column("Detection score", "", "how sure the detection is, 0 to 1"),
    "area_m2": Column("Area", "m²", "of a footprint in plan, of a roof face along its slope"),
    "lod": Column("Level of detail", "", "the finest level that was reached", str),
    "failure_code": Column(
        "Failure", "", "why there is no model, a coarser or a flattened one; see docs/errors.md", str
    ),
    "failure_reason": Column("Reason", "", "the same in a sentence, with its values", str),
    "method": Column("Method", "", "what made the finest level", str),
    "roof_type": Column("Roof type", "", "flat, shed, gable, hip, pyramid or complex", str),
    "h_ground": Column("Ground above the datum", "m", "5th percentile of the terrain on the outline"),
    "ground_source": Column(
        "Source of the base",
        "",
        "measured within 2 m of the outline, interpolated, nearest ground, or surface raster",
        str,
    ),
    "ground_distance_m": Column("Distance of the ground", "m", "the base is from, where none is near"),
    "h_eaves": Column("Eaves above the datum", "m", "lowest corner of the main roof faces"),
    "h_ridge": Column("Ridge above the datum", "m", "highest corner of the main roof faces"),
    "h_50p": Column("Roof above the datum, median", "m", "of the roof points"),
    "h_70p": Column("Roof above the datum, 70th percentile", "m", "of the roof points"),
    "h_max": Column("Top above the datum", "m", "highest corner of all roof faces"),
    "volume_m3": Column("Volume", "m³", "of the finest level's solids"),
    "wall_area_m2": Column("Wall area", "m²", "of all walls of the finest level"),
    "party_wall_area_m2": Column(
        "Party wall area", "m²", "the part of the walls that a neighbour stands against"
    ),
    "free_wall_area_m2": Column("Wall area in the open", "m²", "the walls less their party walls"),
    "free_wall_n_m2": Column("Wall to the north", "m²", "in the open, looking that way"),
    "free_wall_e_m2": Column("Wall to the east", "m²", "in the open, looking that way"),
    "free_wall_s_m2": Column("Wall to the south", "m²", "in the open, looking that way"),
    "free_wall_w_m2": Column("Wall to the west", "m²", "in the open, looking that way"),
    "floor_storeys": Column("Equivalent storeys", "", "floor area over area of the footprint", int),
    "floor_area_m2": Column("Floor area", "m²", "gross, by the map's storeys, else with attics 1.5 m clear"),
    "envelope_m2": Column("Envelope", "m²", "walls in the open, roof along its slopes, ground"),
    "envelope_per_volume": Column("Envelope over volume", "1/m", "small is compact"),
    "roof_area_m2": Column("Roof area", "m²", "along the slopes"),
    "roof_projected_m2": Column("Roof area in plan", "m²", "projected to the horizontal"),
    "roof_face_count": Column("Roof faces", "", "of the finest level", int),
    "rmse_m": Column("RMSE", "m", "root mean square distance of the roof points to the roof"),
    "rmse95_m": Column("RMSE of the best 95 %", "m", "without the worst twentieth of the points"),
    "over_points_m": Column(
        "Height over its points", "m", "of a corner of the roof where no two faces with points meet"
    ),
    "points": Column("Points", "", "number of points", int),
    "density": Column("Density", "points/m²", "points that decide over the area of the footprint"),
    "share_no_data": Column("Share without data", "", "share of the 1 m cells that hold no point"),
    "corners": Column("Corners", "", "of the outline, where it was not given", int),
    "width_m": Column("Width", "m", "of the least rectangle around the outline, where it was not given"),
    "length_m": Column("Length", "m", "of the least rectangle around the outline, where it was not given"),
    "box_share": Column(
        "Share of the box", "", "of the least rectangle or circle around the outline, filled"
    ),
    "outline_agreement": Column(
        "Agreement of the outline", "", "intersection over union with outlines of half of the boundary points"
    ),
    "hidden_share": Column("Occluded outline", "", "share of the outline with no ground points beside it"),
    "blank_share": Column("Blank outline", "", "share of the outline with no points at all beside it"),
    "no_data": Column("No data", "", "over half of the face has no points: filled in, not measured", bool),
    "building_id": Column("Building", "", "id of the building that the face belongs to", str),
    "slope_deg": Column("Slope", "°", "from the horizontal"),
    "azimuth_deg": Column(
        "Azimuth", "°", "clockwise from grid north, the way the face looks; empty where flat"
    ),
    "projected_m2": Column("Area in plan", "m²", "projected to the horizontal"),
    "h_low": Column("Lowest corner above the datum", "m", "of the roof face"),
    "h_high": Column("Highest corner above the datum", "m", "of the roof face"),
    "surface": Column("Surface", "", "RoofSurface, WallSurface, GroundSurface or OuterCeilingSurface", str),
    "face_count": Column("Faces", "", "of this surface", int),
    "roofType": Column("Roof type, code", "", "the code of CityGML's list", str),
    "roof_share_flat": Column("Flat share of the roof", "", "of its area in plan"),
    "roof_share_pitched": Column("Pitched share of the roof", "", "of its area in plan"),
    "measuredHeight": Column("Height above the ground", "m", "from the ground to the top"),
    "ridge_direction_deg": Column("Ridge direction", "°", "clockwise from grid north"),
    "roof_slope_deg": Column("Roof slope", "°", "mean of the pitched main faces"),
    "storeysAboveGround": Column("Storeys", "", "estimated; storeys_source says how", int),
    "storeys_source": Column("Source of the storeys", "", "how they were estimated", str),
    "roof_area_flat_m2": Column("Flat roof area", "m²", "faces flatter than 6°"),
    "roof_area_n_m2": Column("Roof area to the north", "m²", "along the slopes, of faces that look that way"),
    "roof_area_e_m2": Column("Roof area to the east", "m²", "along the slopes, of faces that look that way"),
    "roof_area_s_m2": Column("Roof area to the south", "m²", "along the slopes, of faces that look that way"),
    "roof_area_w_m2": Column("Roof area to the west", "m²", "along the slopes, of faces that look that way"),
    "supported_share": Column(
        "Supported share", "", "of the roof's plan, under faces that their points support"
    ),
    "installation_count": Column("Installations", "", "chimneys and the like that stand on the roof", int),
    "overhang_m": Column("Overhang", "m", "mean over the edges of the roof whose walls are seen (LoD 2.3)"),
    "overhang_known_share": Column(
        "Share of known walls", "", "of the length of the roof's edges, where a wall is seen below"
    ),
    "open_share": Column("Open share", "", "of the length of the roof's edges, without a wall below"),
    "stands_free": Column("Stands free", "", "the roof has open sides and no wall: a canopy", bool),
    "block_id": Column("Block", "", "id of the block of houses that the building is a part of", str),
    "wall_certainty": Column("Certainty of party walls", "", "of the least certain one, 0 to 1"),
    "trust": Column("Trust", "", "high, medium or low; manual where a person set it", str),
    "trust_score": Column(
        "Trust score", "", "probability that nine tenths of its plan lie within 0.2 m of the true roof"
    ),
    "review_reason": Column("Why to review", "", "what lowers the trust, in words", str),
    "rank": Column("Rank", "", "1 is the building to look at first", int),
    "worth_m2": Column("Worth", "m²", "area that is likely wrong: (1 - trust_score) times the area"),
    "link": Column("On the page", "", "the building in report.html beside the file", str),
    "stage": Column("Step", "", "the step of the computation that could not decide", str),
    "reason": Column("Reason", "", "why the place or the building deserves a look, in words", str),
    "inlier_share": Column("Share of points on the roof", "", "or on the face: within 0.2 m"),
    "coverage": Column("Coverage", "", "share of the face's 1 m cells that hold a point"),
    "weak": Column("Weakness", "", "why the face is not supported by its points, in words", str),
    "light_kwh_m2": Column("Sunlight", "kWh/m²", "a year, mean over the face, with shadows"),
    "light_kwh": Column("Sunlight in all", "kWh", "a year, on the whole face or all faces"),
    "shade_share": Column("Share that shadows take", "", "of the light that would come in the open"),
    "sky_share": Column("Share of the sky", "", "of an even sky's light that is left"),
    "covered_share": Column("Covered share", "", "under chimneys, dormers and crowns that are no roof face"),
    "usable_m2": Column("Area for panels", "m²", "along the slope: free, off the rim, sunny, large enough"),
    "usable_kwh_m2": Column("Sunlight on that area", "kWh/m²", "a year"),
    "pv_kwh": Column(
        "Electricity",
        "kWh",
        "a year, from modules on the area for panels; empty without --weather or --annual",
    ),
    "sky": Column("Sky", "", "under which all this is: weather, yearly sum, or clear all year", str),
    **{
        f"light_{number:02d}_kwh_m2": Column(f"Sunlight in {month}", "kWh/m²", "mean over the face")
        for number, month in enumerate(MONTHS, 1)
    },
    "primitive": Column("Primitive", "", "its number among those of the building", int),
    "made_by": Column("Made by", "", "moments, or plane_intersection where it is no standard house", str),
    "house_type": Column("Type of house", "", "flat, shed, gable, hip, half_hip or pyramid", str),
    "house_axes": Column(
        "Source of the axes", "", "of place, axis and sides: the points, a given plan, or the outline", str
    ),
    **{
        f"house_{name}{kind}_{unit}": Column(f"{title}{of}", "°" if unit == "deg" else unit, meaning)
        for kind, of in (("", ""), ("_closed", ", closed solution"), ("_sd", ", standard deviation"))
        for name, unit, title, meaning in HOUSE
    },
    "house_ridge_offset_m": Column("Offset of the ridge", "m", "from the middle of the house"),
    "house_parts": Column("Dormers", "", "and terraces of the house", int),
    "house_parts_m2": Column("Area of the dormers", "m²", "in plan"),
    "house_rmse_m": Column("Residual", "m", "root mean square of the points that the roof explains"),
    "given_attribution": Column(
        "Attribution of the footprint",
        "",
        "whose map it is from, under which licence; to be named",
        str,
    ),
    "given_address": Column("Address", "", "as the map of the footprints has it", str),
    "given_addresses": Column("Addresses", "", "how many the map of the footprints has", int),
    "given_year_built": Column("Year built", "", "as the map of the footprints has it", int),
    "given_use": Column("Use", "", "as the map of the footprints has it", str),
    "given_storeys": Column("Storeys on the map", "", "as the map of the footprints has them", int),
    "given_map_height_m": Column("Height on the map", "m", "as the map of the footprints has it"),
    "edit": Column("Edit", "", "what a user said of the building", str),
    "edit_source": Column("Source of the edit", "", "the file that holds it", str),
    "reviewed": Column("Reviewed", "", "day on which an operator edited or confirmed it", str),
    "change": Column("Change", "", "what became of the building between two epochs", str),
    "also": Column("Also", "", "what else became of it", str),
    "certainty": Column(
        "Certainty", "", "of the change: high, medium or low, from points and share seen", str
    ),
    "height_difference_m": Column("Height difference", "m", "of the roof where it moved, median; up is more"),
    "volume_difference_m3": Column("Volume difference", "m³", "from the points of both epochs"),
    "model_volume_difference_m3": Column("Difference of the models' volumes", "m³", "new minus old"),
    "built_m2": Column("Built", "m²", "roof that stands where the old epoch shows none"),
    "gone_m2": Column("Gone", "m²", "roof that the new epoch shows no more"),
    "moved_m2": Column("Moved", "m²", "roof that lies higher or lower"),
    "points_old": Column("Roof points, old", "", "that decide, in the old epoch", int),
    "points_new": Column("Roof points, new", "", "that decide, in the new epoch", int),
    "share_seen": Column(
        "Share seen", "", "of the roof points at whose place the other epoch shows something"
    ),
    "share_same": Column(
        "Share unchanged", "", "of the roof points with the same surface in the other epoch"
    ),
    "ids_old": Column("Ids, old", "", "of the buildings of the old epoch at this place", str),
    "ids_new": Column("Ids, new", "", "of the buildings of the new epoch at this place", str),
}

LAYERS: dict[str, tuple[str, ...]] = {
    "footprints": (
        *("id", "number", "area_m2", "lod", "method", "roof_type", "h_ground", "h_eaves", "h_ridge", "h_max"),
        *("measuredHeight", "floor_storeys", "floor_area_m2", "volume_m3", "roof_area_m2", "wall_area_m2"),
        *("rmse_m", "points", "block_id", "score", "trust", "trust_score", "review_reason"),
        *("failure_code", "failure_reason"),
    ),
    "attributes": (
        *("id", "roofType", "roof_share_flat", "roof_share_pitched", "ridge_direction_deg", "roof_slope_deg"),
        *("storeysAboveGround", "storeys_source", "roof_area_flat_m2", "roof_area_n_m2", "roof_area_e_m2"),
        *("roof_area_s_m2", "roof_area_w_m2", "roof_projected_m2", "roof_face_count", "h_50p", "h_70p"),
        *(
            "rmse95_m",
            "over_points_m",
            "inlier_share",
            "density",
            "share_no_data",
            "supported_share",
            "installation_count",
            "overhang_m",
        ),
        *("overhang_known_share", "open_share", "stands_free", "wall_certainty", "ground_source"),
        *("ground_distance_m", "party_wall_area_m2", "free_wall_area_m2", "free_wall_n_m2", "free_wall_e_m2"),
        *("free_wall_s_m2", "free_wall_w_m2", "envelope_m2", "envelope_per_volume"),
        *("corners", "width_m", "length_m", "box_share", "outline_agreement", "hidden_share", "blank_share"),
    ),
    "roof_planes": (
        *("building_id", "lod", "slope_deg", "azimuth_deg", "area_m2", "projected_m2", "rmse_m", "points"),
        *("share_no_data", "no_data", "h_low", "h_high", "h_ground", "inlier_share", "density", "coverage"),
        "weak",
    ),
    "primitives": (
        *("building_id", "primitive", "made_by", "house_type", "house_axes"),
        *(f"house_{name}{kind}_{unit}" for name, unit, *_ in HOUSE for kind in ("", "_closed", "_sd")),
        *("house_ridge_offset_m", "house_parts", "house_parts_m2", "house_rmse_m"),
    ),
}
"""The columns of a run's layers, in their order: also those of a layer without rows. `attributes` is a table
of further columns of the footprints, by `id`; a column of neither is in `footprints`."""
DETAILS = frozenset(LAYERS["attributes"]) - {"id"}
