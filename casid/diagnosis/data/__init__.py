"""Faults of the data, before anything is believed: signs, units, swaps, frozen, clipped and held channels."""
