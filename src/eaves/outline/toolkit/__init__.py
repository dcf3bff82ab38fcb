"""Steps that several outline methods share."""
