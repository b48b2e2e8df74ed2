"""Multirotors: flights by RotorPy with hidden effects, and CrazyPAD, a nano-quadrotor with known damage."""
