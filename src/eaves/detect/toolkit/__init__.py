"""Steps that several detectors share."""
