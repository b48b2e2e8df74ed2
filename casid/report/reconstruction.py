"""Latent inputs for plots: what is missing at each place, with the structure of the model taken as exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, response
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.result import Diagnosis


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction:
    """Station -> latent input there, by the re-estimated and by the extended model."""

    before: dict[str, MissingInput]
    after: dict[str, MissingInput]


def reconstruct(diagnosis: Diagnosis) -> Reconstruction:
    """Both sets of latent inputs by station."""
    return Reconstruction(before=_by_station(diagnosis.missing_before), after=_by_station(diagnosis.missing_after))


def derivatives_beside(fit: FlightFit, missing: MissingInput) -> dict[str, float]:
    """Fitted derivatives with the latent input in place, which they need not imitate any more.

    The mean of the joint posterior of derivatives and input, from the same linearisation as the input itself.
    """
    evidence = weigh(fit, discrepancy=False)
    series = np.zeros((*fit.batch.live.shape, 1))
    for r, record in enumerate(fit.flight.records):
        t, mean, _ = missing.history[record.name]
        series[: len(record), r, 0] = np.interp(record.t, t, mean)
    white = response(fit, missing.station, series)
    taken = fit.columns.reshape(fit.white.size, len(fit.slots)).T @ white.reshape(-1)
    values = fit.values + evidence.newton - evidence.covariance @ taken
    return {slot.name: float(value) for slot, value in zip(fit.slots, values, strict=True)}


def _by_station(found: Sequence[MissingInput]) -> dict[str, MissingInput]:
    return {one.station: one for one in found}
