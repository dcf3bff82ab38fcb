"""What a country of tiles costs, and whether the tiling can be seen in the result."""
