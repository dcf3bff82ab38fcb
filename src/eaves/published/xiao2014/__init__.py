"""Xiao et al. 2014: a framework from points to models. Its recipe, and its steps beside it."""

from eaves.recipe.recipe import PublishedSource

SOURCE = PublishedSource(
    "xiao2014",
    "xiao2014",
    "Xiao, Wang, Xi and Zhang 2014: A comprehensive framework of building model "
    "reconstruction from airborne LiDAR data",
    "3D models of intersected roof planes inside regular outlines",
    {
        "ground": "smooth_region",
        "detect": "normal_echo",
        "outline": "ransac_lines",
        "roof": "region_growing",
        "reconstruct": "plane_intersection",
    },
    "2.2",
)
