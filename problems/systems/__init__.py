"""Dynamic systems other than aircraft, flown by simulators of their own that hide a fault."""
