"""Steps of squares and blocks fixed to the world: what is wide, the ground, rasters and regions."""
