"""What several outline methods share."""
