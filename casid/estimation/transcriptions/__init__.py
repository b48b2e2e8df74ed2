"""How a trajectory is represented: shooting, collocation, equations on measured signals."""
