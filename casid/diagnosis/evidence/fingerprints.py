"""Fingerprints: the whitened response of the linearised, filtered aircraft to a unit of a cause.

They are kept for each record, as sums over its samples. A cause that acts in some records only therefore needs no
further pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence, cross_of
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings, station_series
from casid.filtering.innovations import linearise
from casid.model.effect import Effect
from casid.model.operators import CYCLES
from casid.model.station import Station
from casid.native.processors import side_by_side


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Fingerprint:
    """Sums over each record of the whitened response m to one cause.

    square  (R,) m'm
    cross   (R, k) products with the sensitivities to the fitted parameters
    match   (R,) products with the innovations
    """

    effect: Effect
    values: Mapping[str, float]
    onset: float | None
    square: np.ndarray
    cross: np.ndarray
    match: np.ndarray


_Row = tuple[Effect, Mapping[str, float], float | None]  # an effect, its further values, and its onset


def fingerprints(evidence: Evidence, effects: Iterable[Effect], onsets: np.ndarray | None = None) -> list[Fingerprint]:
    """The fingerprints of effects on the complete grid of their further values and onsets.

    `onsets` are in s after the first sample of each record; the default is `onset_grid`. Oscillations that are too fast
    for the samples are left out.
    """
    effects, base = list(effects), evidence.fit
    slowest = max(float(np.median(np.diff(record.t))) for record in base.flight.records)
    rows: list[_Row] = []
    for effect in effects:
        for values in effect.grid:
            if values.get("frequency_hz", 0.0) * slowest > CYCLES:
                continue
            if not effect.timed:
                rows.append((effect, values, None))
                continue
            at = onset_grid(evidence, length=values.get("length", np.inf)) if onsets is None else onsets
            rows += [(effect, values, float(onset)) for onset in at]
    rows.sort(key=lambda row: row[2] or 0.0)  # samples before the first onset of a group need no work
    symbolic = symbolic_columns(base, [e for e, _, _ in rows if e.symbolic and not e.quasi_steady])
    direct = [row for row in rows if not _a_history(row[0])]
    known = [row for row in rows if _a_history(row[0])]

    # The transposed filter costs as much as one response for each parameter and small term.
    entrances = Entrances.of(evidence, base.model.disturbances) if len(known) > len(evidence.newton) else None

    def some(of: Sequence[_Row]) -> list[Fingerprint]:
        """The fingerprints of some rows of one kind."""
        if not _a_history(of[0][0]):
            return _fingerprints(evidence, of, _white_direct(base, of, symbolic))
        histories = [_unit_history(base, *row) for row in of]
        return _of_histories(evidence, of, histories, entrances)

    together = _together(base)
    parts = [of[at : at + together] for of in (known, direct) for at in range(0, len(of), together)]
    return [print_ for found in side_by_side(some, parts) for print_ in found]


def onset_grid(evidence: Evidence, step: float | None = None, length: float = np.inf) -> np.ndarray:
    """Onsets [s] after the first sample of a record.

    They are `step` apart, by default as in screening. In long records the distance grows with the record, so that the
    work grows in proportion to it, but not beyond the `length` of the event.
    """
    longest = max(record.duration for record in evidence.fit.flight.records)
    numerics, edge = evidence.criteria.numerics.screening, evidence.criteria.screening.edge
    step = numerics.onset_step if step is None else step
    wider = max(step, min(step * longest / numerics.fine_up_to, length))
    return np.arange(edge, longest - edge, wider)


def _a_history(effect: Effect) -> bool:
    """Whether an effect consists of time histories at disturbances of the model."""
    return effect.quasi_steady or (effect.series is not None and not effect.symbolic)


def _of_histories(
    evidence: Evidence,
    rows: Sequence[_Row],
    histories: Sequence[Mapping[str, np.ndarray]],
    entrances: Entrances | None,
) -> list[Fingerprint]:
    """The fingerprints of rows that are time histories by port."""
    if entrances is None:
        return _fingerprints(evidence, rows, _whitened(evidence.fit, histories))
    square = evidence.fit.filter.squares_of_histories(*_entering(evidence.fit, histories))
    R = len(evidence.by_record)
    cross, match = np.zeros((R, len(evidence.newton), len(rows))), np.zeros((R, len(rows)))
    for station in dict.fromkeys(station for one in histories for station in one):
        at = [j for j, one in enumerate(histories) if station in one]
        products = entrances.products(station, np.stack([histories[j][station] for j in at], axis=2))
        cross[:, :, at] += products[0]
        match[:, at] += products[1]
    return _each(rows, square, cross, match)


def _fingerprints(evidence: Evidence, rows: Sequence[_Row], white: np.ndarray) -> list[Fingerprint]:
    """The fingerprints from whitened responses (last samples, R, ny, rows); earlier samples are zero."""
    before = evidence.fit.white[: len(evidence.fit.white) - len(white), 0].size
    parts = [white[:, r].reshape(-1, len(rows)) for r in range(white.shape[1])]
    square = np.stack([np.einsum("kj,kj->j", w, w) for w in parts])
    cross = np.stack([cross_of(c[before:], w) for c, w in zip(evidence.by_record, parts, strict=True)])
    match = np.stack([evidence.fit.white[:, r].reshape(-1)[before:] @ w for r, w in enumerate(parts)])
    return _each(rows, square, cross, match)


def _each(rows: Sequence[_Row], square: np.ndarray, cross: np.ndarray, match: np.ndarray) -> list[Fingerprint]:
    """The fingerprints from sums (R, rows), (R, k, rows) and (R, rows)."""
    return [
        Fingerprint(effect=e, values=v, onset=o, square=square[:, j], cross=cross[:, :, j], match=match[:, j])
        for j, (e, v, o) in enumerate(rows)
    ]


def responses(evidence: Evidence, rows: Sequence[_Row]) -> list[np.ndarray]:
    """For each record (samples, rows): whitened responses to a unit of effects with these values and onsets.

    For an effect that is not linear it is the response to the complete effect.
    """
    base = evidence.fit
    symbolic = symbolic_columns(base, [e for e, _, _ in rows if e.symbolic and not e.quasi_steady])
    white = np.zeros((*base.white.shape, len(rows)))
    for history_rows in (True, False):
        at = [j for j, row in enumerate(rows) if _a_history(row[0]) == history_rows]
        if not at:
            continue
        some = [rows[j] for j in at]
        if history_rows:
            found = _whitened(base, [_unit_history(base, *row) for row in some])
        else:
            found = _white_direct(base, some, symbolic)
        white[len(white) - len(found) :, ..., at] = found
    return [white[:, r].reshape(-1, len(rows)) for r in range(len(base.batch.names))]


def symbolic_columns(base: FlightFit, effects: Sequence[Effect]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name -> (Y, F) of symbolic effects, from the Jacobians of a model that contains all of them at zero effect."""
    already = [a.effect for a in base.attached]
    effects = [e for e in effects if e.name not in {a.name for a in already}]
    if not effects:
        return {}
    model = base.flight.model([*already, *effects])
    P = np.tile(model.nominal_vector(), (len(base.batch.names), 1))
    P[:, [model.parameters.index(name) for name in base.model.parameters]] = base.parameters
    names = [e.name for e in effects]
    linear = linearise(base.flight.functions(model, names), base.batch, P, base.linear.X, base.moving)
    return {name: (linear.Dp[..., i], linear.Bp[..., i]) for i, name in enumerate(names)}


def _unit_history(
    base: FlightFit, effect: Effect, values: Mapping[str, float], onset: float | None
) -> Mapping[str, np.ndarray]:
    """Port -> (N, R) time history of a unit of an effect."""
    if effect.quasi_steady:
        term = base.flight.term_along(effect, base.regressors)
        return {str(effect.enters): np.broadcast_to(term, base.batch.live.shape)}
    return station_series(_unit(effect, values, onset, base), base.batch.names, base.batch.t, base.known)


def history(base: FlightFit, one: Attached) -> np.ndarray:
    """(N, R, nw) Time histories that an effect adds at the disturbances of a fit."""
    return disturbance_series([one], base.batch.names, base.batch.t, base.known, base.model.disturbances)


def _by_station(base: FlightFit, W: np.ndarray) -> dict[str, np.ndarray]:
    """Port -> (N, R) time history of those of (N, R, nw) that are not zero; the first port if all are. Copies: W is
    large.
    """
    acting = np.flatnonzero(W.any(axis=(0, 1)))
    return {base.model.disturbances[s]: W[..., s].copy() for s in (acting if len(acting) else [0])}


def _entering(
    base: FlightFit, histories: Sequence[Mapping[str, np.ndarray]]
) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Time histories by port as arrays.

    Returns
    -------
    stations
        Index of the disturbance of each series.
    series
        (N, R, number of series)
    first
        Index of the first series of each history.
    """
    stations = [base.model.disturbances.index(station) for one in histories for station in one]
    series = np.stack([h for one in histories for h in one.values()], axis=2)
    parts = np.array([len(one) for one in histories])
    return stations, series, np.cumsum(parts) - parts


def _whitened(base: FlightFit, histories: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
    """(last samples, R, ny, histories) Whitened responses to time histories by port, from the first nonzero sample."""
    stations, series, first = _entering(base, histories)
    begins = int(np.argmax(series.any(axis=(1, 2))))
    return base.filter.whiten_histories(stations, series, first)[begins:]


def prints_of(evidence: Evidence, effect: Effect, histories: Iterable[np.ndarray]) -> list[Fingerprint]:
    """The fingerprints of time histories (N, R, nw) as those of an effect."""
    found, following = [], (_by_station(evidence.fit, one) for one in histories)
    while some := list(islice(following, _together(evidence.fit))):
        found += _fingerprints(evidence, [(effect, {}, None)] * len(some), _whitened(evidence.fit, some))
    return found


def _together(base: FlightFit) -> int:
    """Number of responses that are in memory at a time."""
    numerics = base.criteria.numerics.screening
    return int(np.clip(numerics.responses / base.white.size, numerics.fewest_responses, numerics.most_responses))


def _white_direct(base: FlightFit, rows: Sequence[_Row], symbolic: Mapping) -> np.ndarray:
    """(N, R, ny, rows) Whitened responses to effects in the equations of the model, or on readings.

    Effects in the equations are computed from Jacobians. For an effect on readings that is not linear it is the
    response to the complete effect.
    """
    seen, shape = base.linear.seen, base.linear.defect.shape
    outputs, states = [], {}
    for i, (effect, values, onset) in enumerate(rows):
        if effect.symbolic:
            Y, F = symbolic.get(effect.name, (np.zeros(base.read.shape), np.zeros(shape)))
            outputs.append(Y)
            states[i] = F
            continue
        one, output = _unit(effect, values, onset, base), base.read
        read = readings([one], base.batch.names, base.batch.t, output, base.model.outputs, base.known)
        outputs.append(np.where(seen, read - output, 0.0))
    F = np.zeros((*shape, len(rows)))
    for i, state in states.items():
        F[..., i] = state
    # Rows are transposed at the end, because writing columns one by one takes twice the time.
    Y = np.stack(outputs).reshape(len(rows), -1).T.reshape(*base.read.shape, len(rows))
    return base.filter.whiten(Y, F)


def _unit(effect: Effect, values: Mapping[str, float], onset: float | None, base: FlightFit) -> Attached:
    """The effect at unit amplitude in every record, with its onset counted from the first sample of each record."""
    onsets = {r.name: r.t[0] + onset for r in base.flight.records} if onset is not None else {}
    return Attached(effect=effect, values={"value": 1.0} | dict(values), onsets=onsets)
