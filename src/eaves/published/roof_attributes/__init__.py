"""Buildings from roof points' attributes. Its recipe, and its steps beside it."""

from eaves.recipe.recipe import PublishedSource

SOURCE = PublishedSource(
    "roof_attributes",
    "roof_attributes",
    "Detection building point clouds from airborne LiDAR data using roof points' attributes",
    "the points of buildings",
    {"ground": "adaptive_tin", "detect": "roof_attributes", "outline": "alpha_shape"},
    "0",
)
