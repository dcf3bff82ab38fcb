"""Maas and Vosselman 1999: invariant moments, and faces intersected. Its recipe, and its steps beside it."""

from eaves.recipe.recipe import PublishedSource

SOURCE = PublishedSource(
    "maas_vosselman",
    "maas_vosselman1999",
    "Maas and Vosselman 1999: Two algorithms for extracting building models from raw laser altimetry data",
    "3D models: standard houses from moments, others from intersected faces",
    {
        "ground": "adaptive_tin",
        "detect": "height_texture",
        "outline": "ransac_lines",
        "roof": "tin_faces",
        "reconstruct": "maas_vosselman",
    },
    "2.2",
)
