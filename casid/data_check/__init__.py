"""Faults of the data, before anything is estimated: signs, units, swaps, frozen, clipped and held channels."""
