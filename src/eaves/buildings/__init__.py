"""Steps of buildings: joined across blocks, gathered, outlined, divided, modelled; their rows."""
