"""Steps that several roof segmentations share."""
