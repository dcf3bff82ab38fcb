"""Functions that several ground filters share."""
