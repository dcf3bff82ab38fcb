"""The rest of the points: water, bridges, wires and their towers, vegetation."""
