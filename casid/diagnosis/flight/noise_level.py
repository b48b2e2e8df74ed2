"""Noise of channels whose high band does not show it: from what a first fit leaves above the manoeuvre.

A channel that was filtered before sampling seems almost free of noise, and every small misfit in it would be evidence.
The model is therefore fitted with such channels at a share of their variation, flown freely, and the density of what
is left in the octave above the motion becomes their noise. Once more with that noise. So evidence is weighed against
what is left at frequencies where the model moves little. If the noise is denser still in the band of the motion, as
turbulence and slow drifts are, the scores stay too confident, and if a fault shows above it, too cautious. Not touched:
channels whose high band holds, and channels whose noise the aircraft file states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.statistics import free_simulation
from casid.records.record import Record


def with_noise_level(flight: Flight, attached: Sequence[Attached]) -> Flight:
    """The flight with the noise of its doubted outputs judged by the model that `attached` extends, and that of its
    inputs by what a filter common to all channels took from the outputs."""
    return _by_the_model(flight, attached).with_filtered_inputs().within_the_motion()


def _by_the_model(flight: Flight, attached: Sequence[Attached]) -> Flight:
    if not flight.doubted:
        return flight
    criteria, numerics = flight.criteria.noise, flight.criteria.numerics.fit
    variation = {o: float(np.nanstd(np.concatenate([r[o] for r in flight.records]))) for o in flight.doubted}
    first = {o: max(flight.sigma[o], criteria.first * v) for o, v in variation.items()}
    now = replace(flight, sigma=flight.sigma | first)
    fitted = None
    for _ in range(numerics.noise_fits):
        tolerance = numerics.noise_tolerance
        fitted = fit(now, attached, now.noise(), fitted, iterations=numerics.noise_iterations, tolerance=tolerance)
        residual = free_simulation(fitted).residual
        now = flight.with_noise_above(
            [_left(now, record, residual[: len(record), r]) for r, record in enumerate(now.records)]
        )
    return now


def _left(flight: Flight, record: Record, residual: np.ndarray) -> Record:
    return record.with_channels(**{o: residual[:, i] for i, o in enumerate(flight.outputs)})
