"""What time histories have in common with all that is fitted: one pass of the transposed filter for all of them.

The products of a whitened response with the fitted slots cost more than the response itself. Their sum over the outputs
is the same for every history that enters at a place, and is done here once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence
from casid.model.station import Station


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrances:
    """By station (R, N, k + 1) what the response to a unit at a sample has in common with the fitted slots and small
    terms of an evidence, and last with its innovations."""

    by_station: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, evidence: Evidence, stations: Sequence[str]) -> Entrances:
        """Of disturbances of the model and of readings."""
        fit = evidence.fit
        (N, R, ny), k = fit.white.shape, len(evidence.newton)
        columns = np.empty((R, N, ny, k + 1))
        for r, flat in enumerate(evidence.by_record):
            columns[r, ..., :k] = flat.reshape(N, ny, k)
        columns[..., k] = fit.white.swapaxes(0, 1)
        entering = [name for name in stations if Station.at(name).kind != "reading"]
        index = [fit.model.disturbances.index(name) for name in entering]
        by_disturbance, by_output = fit.filter.entrances(index, columns, read=len(entering) < len(stations))
        found = dict(zip(entering, by_disturbance, strict=True))
        for name in set(stations) - set(entering):
            channel = fit.model.outputs.index(Station.at(name).name)
            found[name] = by_output[channel] * fit.linear.seen[:, :, channel].T[..., None]
        return cls(by_station=found)

    def products(self, station: str, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(cross (R, k, n), match (R, n)) of the whitened responses to time histories (N, R, n) at a station with what
        is fitted and with the innovations."""
        both = self.by_station[station].swapaxes(1, 2) @ series.swapaxes(0, 1)
        return both[:, :-1], both[:, -1]
