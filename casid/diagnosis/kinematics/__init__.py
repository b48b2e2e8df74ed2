"""What needs no aerodynamics."""
