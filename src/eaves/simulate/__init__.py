"""Towns, roofs and scans of which everything is known."""
