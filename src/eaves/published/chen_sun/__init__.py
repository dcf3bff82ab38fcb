"""Chen and Sun: buildings from planar patches. Its recipe, and its steps beside it."""

from eaves.recipe.recipe import PublishedSource

SOURCE = PublishedSource(
    "chen_sun",
    "chen_sun_vaihingen",
    "Chen and Sun: Brief description of building detection from airborne LiDAR "
    "data based on extraction of planar structure",
    "a mask and the contours of buildings",
    {"ground": "adaptive_tin", "detect": "planar_patches", "outline": "alpha_shape"},
    "0",
)
