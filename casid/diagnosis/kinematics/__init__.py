"""Checks that need no aerodynamics."""
