"""Proof of match: a simulation against flight, by the tolerances of the standards."""
