"""Normal equations of responses with the fitted parameters eliminated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence
from casid.model.station import Station


@dataclass(frozen=True, eq=False, kw_only=True)
class Projection:
    """Normal equations of n whitened responses, with fitted parameters and small terms eliminated.

    gram   (n, n) products of the projected responses: the information on their sizes
    match  (n,) their products with the innovations
    """

    gram: np.ndarray
    match: np.ndarray

    @classmethod
    def shared(cls, evidence: Evidence, responses: Mapping[int, np.ndarray]) -> Projection:
        """For responses with one size in all records: index of the record -> (samples, n)."""
        n = next(iter(responses.values())).shape[1]
        gram, match, cross = np.zeros((n, n)), np.zeros(n), np.zeros((len(evidence.newton), n))
        for r, own in responses.items():
            gram += own.T @ own
            cross += evidence.by_record[r].T @ own
            match += own.T @ evidence.fit.white[:, r].reshape(-1)
        return cls._eliminated(evidence, gram, match, cross)

    @classmethod
    def by_record(cls, evidence: Evidence, grams: np.ndarray, products: tuple[np.ndarray, np.ndarray]) -> Projection:
        """For responses with separate sizes in every record: n of the first record, and so on.

        `grams` (R, n, n) are the products of the responses with each other, `products` those of `Entrances`.
        """
        R, n = grams.shape[:2]
        gram, match = np.zeros((R * n, R * n)), np.zeros(R * n)
        cross = np.zeros((len(evidence.newton), R * n))
        for r, own in enumerate(grams):
            at = slice(r * n, (r + 1) * n)
            gram[at, at] = own
            cross[:, at], match[at] = products[0][r], products[1][r]
        return cls._eliminated(evidence, gram, match, cross)

    @classmethod
    def _eliminated(cls, evidence: Evidence, gram: np.ndarray, match: np.ndarray, cross: np.ndarray) -> Projection:
        """The projection from products before elimination; `cross` (k, n) with parameters and small terms."""
        spent = cross.T @ evidence.covariance @ cross
        return cls(gram=gram - spent, match=match - cross.T @ evidence.newton)


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrances:
    """Products of the response to a unit at every sample with the parameters, small terms and innovations of an
    evidence.

    by_station  port -> (R, N, k + 1), the innovations last
    """

    by_station: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, evidence: Evidence, stations: Sequence[str]) -> Entrances:
        """The products for disturbances of the model and readings."""
        (N, R, _), k = evidence.fit.white.shape, len(evidence.newton)
        found = {name: np.empty((R, N, k + 1)) for name in stations}
        for name, some, part in _parts(evidence, stations):
            found[name][..., some] = part
        return cls(by_station=found)

    def products(self, station: str, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Products of the whitened responses to time histories (N, R, n) at a port.

        Returns
        -------
        cross
            (R, k, n) With fitted parameters and small terms.
        match
            (R, n) With the innovations.
        """
        both = self.by_station[station].swapaxes(1, 2) @ series.swapaxes(0, 1)
        return both[:, :-1], both[:, -1]


def products_at(evidence: Evidence, series: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Port -> `Entrances.products` of the time histories (N, R, n) there, computed in parts to save memory."""
    R, k = len(evidence.by_record), len(evidence.newton)
    both = {name: np.empty((R, k + 1, of.shape[2])) for name, of in series.items()}
    for name, some, part in _parts(evidence, list(series)):
        both[name][:, some] = part.swapaxes(1, 2) @ series[name].swapaxes(0, 1)
    return {name: (of[:, :-1], of[:, -1]) for name, of in both.items()}


def _parts(evidence: Evidence, stations: Sequence[str]) -> Iterator[tuple[str, slice, np.ndarray]]:
    """(port, columns, (R, N, columns)) Products of the response to a unit at a sample with some columns, by port."""
    fit, k = evidence.fit, len(evidence.newton)
    entering = [name for name in stations if name in fit.model.disturbances]
    index = [fit.model.disturbances.index(name) for name in entering]
    channels = {name: fit.model.outputs.index(Station.at(name).name) for name in set(stations) - set(entering)}
    together = fit.criteria.numerics.screening.columns
    for first in range(0, k + 1, together):
        some = slice(first, min(first + together, k + 1))
        by_disturbance, by_output = fit.filter.entrances(index, _columns(evidence, some), read=bool(channels))
        for name, one in zip(entering, by_disturbance, strict=True):
            yield name, some, one
        for name, channel in channels.items():
            yield name, some, by_output[channel] * fit.linear.seen[:, :, channel].T[..., None]


def _columns(evidence: Evidence, some: slice) -> np.ndarray:
    """(R, N, ny, columns) Some of the columns of fitted parameters and small terms; the innovations are the last
    column.
    """
    fit, k = evidence.fit, len(evidence.newton)
    (N, R, ny), fitted = fit.white.shape, min(some.stop, k) - some.start
    columns = np.empty((R, N, ny, some.stop - some.start))
    for r, flat in enumerate(evidence.by_record):
        columns[r, ..., :fitted] = flat[:, some.start : some.start + fitted].reshape(N, ny, fitted)
    if some.stop > k:
        columns[..., -1] = fit.white.swapaxes(0, 1)
    return columns
