"""What time does to results: two epochs compared, results updated, corrected, and learned from."""
