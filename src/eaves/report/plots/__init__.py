"""Plots of a run with matplotlib: plan, section, axonometry, errors."""
