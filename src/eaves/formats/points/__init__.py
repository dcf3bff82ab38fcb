"""Point files: LAS, LAZ, COPC and text, read in chunks and written with classes."""
