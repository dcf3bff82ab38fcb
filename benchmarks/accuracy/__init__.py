"""Accuracy against truth, one module a stage."""
