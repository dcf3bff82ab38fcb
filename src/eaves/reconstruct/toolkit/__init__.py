"""What several reconstructors share."""
