"""Results over time: two epochs compared, results updated, corrected, and learned from."""
