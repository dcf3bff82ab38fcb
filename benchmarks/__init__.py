"""Tables of speed and accuracy that anyone can run."""
