"""Steps that several reconstructors share."""
