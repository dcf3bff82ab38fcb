"""Ren et al.: the contour method Fc-S. Its recipe, and its steps beside it."""

from eaves.recipe.recipe import PublishedSource

SOURCE = PublishedSource(
    "ren_fcs",
    "ren_fcs",
    "Ren, Zhou, Cen, Zhang and Zhang: A novel method for extracting building from LIDAR data: Fc-S method",
    "the areas of buildings, on undulating terrain and beside vegetation",
    {"ground": "contours", "detect": "contours", "outline": "alpha_shape"},
    "0",
)
