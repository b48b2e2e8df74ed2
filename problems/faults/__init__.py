"""Faults of the data, hidden in flights of simulators and in real ones: what does the check find?"""
