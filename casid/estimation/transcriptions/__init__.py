"""Represent a trajectory: shooting, collocation, equations on measured signals."""
