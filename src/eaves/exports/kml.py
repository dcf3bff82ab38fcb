"""Footprints and roof planes as KML, in longitude and latitude."""

from eaves.formats import Format, write_polygons, write_roof_planes

FORMAT = Format(
    {
        "footprints": ("footprints.kml", write_polygons),
        "roof_planes": ("roof_planes.kml", write_roof_planes),
    }
)
