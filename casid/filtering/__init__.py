"""Kalman filtering: innovations of a linearised model, and filter error, the one way of process noise."""
