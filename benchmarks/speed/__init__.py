"""Time and memory of the whole job."""
