"""Faults of the data that channels show together."""
