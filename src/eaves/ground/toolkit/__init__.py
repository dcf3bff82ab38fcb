"""What several ground filters share."""
