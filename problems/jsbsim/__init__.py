"""Flights of JSBSim aircraft with faults made in JSBSim."""
