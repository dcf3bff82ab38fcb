"""A whole run: what is asked for, its steps in order, tiles, and the files that it writes."""
