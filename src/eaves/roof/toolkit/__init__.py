"""What several roof segmentations share."""
