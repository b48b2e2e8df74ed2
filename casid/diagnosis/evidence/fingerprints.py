"""Fingerprints: the whitened response of the linearised, filtered aircraft to a unit of a cause.

They are kept for each record, as sums over its samples. A cause that acts in some records only therefore needs no
further pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Literal

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings, station_series
from casid.diagnosis.flight.terms import term_along
from casid.filtering.innovations import inject
from casid.filtering.kernel import COLUMNS
from casid.model.effect import Effect, with_grid
from casid.model.operators import CYCLES
from casid.model.station import Station, reading
from casid.native.processors import side_by_side


@dataclass(frozen=True, eq=False, kw_only=True)
class Projection:
    """Normal equations of n whitened responses, with fitted parameters and small terms eliminated."""

    gram: np.ndarray  # (n, n) products of the projected responses: the information on their sizes
    match: np.ndarray  # (n,) their products with the innovations

    @classmethod
    def shared(cls, evidence: Evidence, white: np.ndarray) -> Projection:
        """For whitened responses (N, R, ny, n) with one size in all records."""
        flat = white.reshape(-1, white.shape[3])
        cross = evidence.products(white).sum(axis=0)
        return cls.of(evidence, flat.T @ flat, evidence.fit.white.reshape(-1) @ flat, cross)

    @classmethod
    def by_record(cls, evidence: Evidence, grams: np.ndarray, products: tuple[np.ndarray, np.ndarray]) -> Projection:
        """For responses with separate sizes in every record: n of the first record, and so on.

        `grams` (R, n, n) are the products of the responses with each other, `products` those of `Entrances`.
        """
        R, n = grams.shape[:2]
        gram = np.zeros((R * n, R * n))
        match = np.zeros(R * n)
        cross = np.zeros((len(evidence.newton), R * n))
        for r, own in enumerate(grams):
            at = slice(r * n, (r + 1) * n)
            gram[at, at] = own
            cross[:, at] = products[0][r]
            match[at] = products[1][r]
        return cls.of(evidence, gram, match, cross)

    @classmethod
    def of(cls, evidence: Evidence, gram: np.ndarray, match: np.ndarray, cross: np.ndarray) -> Projection:
        """The projection from products before elimination; `cross` (k, n) with parameters and small terms."""
        spent = cross.T @ evidence.covariance @ cross
        return cls(gram=gram - spent, match=match - cross.T @ evidence.newton)


def products_at(evidence: Evidence, series: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Products of the whitened responses to time histories (N, R, n) at ports, by the transposed filter.

    It runs once over the columns of the evidence, a few at a time to save memory, whatever the number of histories.

    cross  port -> (R, k, n) with fitted parameters and small terms
    match  port -> (R, n) with the innovations
    """
    R = evidence.fit.white.shape[1]
    k = len(evidence.newton)
    both = {port: np.empty((R, k + 1, of.shape[2])) for port, of in series.items()}
    for here, own in evidence.in_records():
        for port, columns, part in _entrances(own, list(series)):
            both[port][here, columns] = part.swapaxes(1, 2) @ series[port][:, here].swapaxes(0, 1)
    return {port: (of[:, 1:], of[:, 0]) for port, of in both.items()}


def _entrances(evidence: Evidence, ports: Sequence[str]) -> Iterator[tuple[str, slice, np.ndarray]]:
    """(port, which columns of the evidence, (R, N, columns)) What the columns have in common with the response to a
    unit at each sample of a port; the innovations are the first column.
    """
    fit = evidence.fit
    entering = [port for port in ports if port in fit.model.disturbances]
    index = [fit.model.disturbances.index(port) for port in entering]
    channels = {port: fit.model.outputs.index(Station.at(port).name) for port in ports if port not in entering}
    for first, columns in evidence.columns(COLUMNS):
        some = slice(first, first + columns.shape[3])
        by_disturbance, by_output = fit.filter.entrances(index, columns, read=bool(channels))
        read = ((port, by_output[i] * fit.seen[:, :, i].T[..., None]) for port, i in channels.items())
        for port, part in chain(zip(entering, by_disturbance, strict=True), read):
            yield port, some, part


@dataclass(frozen=True, eq=False, kw_only=True)
class Fingerprint:
    """Sums over each record of the whitened response m to one cause."""

    effect: Effect
    values: Mapping[str, float]
    onset: float | None
    square: np.ndarray  # (R,) m'm
    cross: np.ndarray  # (R, k) products with the sensitivities to the fitted parameters
    match: np.ndarray  # (R,) products with the innovations


_Row = tuple[Effect, Mapping[str, float], float | None]  # an effect, its further values, and its onset
_History = Mapping[str, np.ndarray]  # port -> (N, R)


def fingerprints(evidence: Evidence, effects: Iterable[Effect], onsets: np.ndarray | None = None) -> list[Fingerprint]:
    """The fingerprints of effects on the complete grid of their further values and onsets.

    `onsets` are in s after the first sample of each record; the default is `onset_grid`. Oscillations that are too fast
    for the samples are left out.
    """
    effects = list(effects)
    base = evidence.fit
    slowest = max(float(np.median(np.diff(record.t))) for record in base.flight.records)
    rows: list[_Row] = []
    for effect in effects:
        for values in effect.further.grid:
            if values.get("frequency_hz", 0.0) * slowest > CYCLES:
                continue
            if not effect.timed:
                rows.append((effect, values, None))
                continue
            at = onset_grid(evidence, length=values.get("length", np.inf)) if onsets is None else onsets
            rows += [(effect, values, float(onset)) for onset in at]
    rows.sort(key=lambda row: row[2] or 0.0)  # samples before the first onset of a group need no work
    by_records = [_of_rows(own, rows) for _, own in evidence.in_records()]
    return by_records[0] if len(by_records) == 1 else [_together(parts) for parts in zip(*by_records, strict=True)]


def _together(parts: Sequence[Fingerprint]) -> Fingerprint:
    """The fingerprint with the sums of all records, from those of some records after the other."""
    sums = {name: np.concatenate([getattr(one, name) for one in parts]) for name in ("square", "cross", "match")}
    return replace(parts[0], **sums)


def _of_rows(evidence: Evidence, rows: Sequence[_Row]) -> list[Fingerprint]:
    """The fingerprints of rows, by place."""
    base = evidence.fit
    by_place: dict[str, list[_Row]] = {"disturbances": [], "readings": [], "equations": []}
    for row in rows:
        by_place[_acts_on(row[0])].append(row)
    found = [one for place in ("disturbances", "readings") for one in _of_histories(evidence, by_place[place])]
    symbolic = _symbolic_columns(base, [effect for effect, _, _ in by_place["equations"]])
    equations = by_place["equations"]
    together = COLUMNS
    for some in (equations[at : at + together] for at in range(0, len(equations), together)):
        found += _fingerprints(evidence, some, _white_of_equations(base, some, symbolic))
    return found


def onset_grid(evidence: Evidence, step: float | None = None, length: float = np.inf) -> np.ndarray:
    """Onsets [s] after the first sample of a record.

    They are `step` apart, by default as in screening. In long records the distance grows with the record, so that the
    work grows in proportion to it, but not beyond the `length` of the event.
    """
    longest = max(record.duration for record in evidence.fit.flight.records)
    numerics = evidence.criteria.numerics.events
    step = numerics.step if step is None else step
    wider = max(step, min(step * longest / evidence.criteria.numerics.record, length))
    return np.arange(numerics.step, longest - numerics.step, wider)


def _acts_on(effect: Effect) -> Literal["disturbances", "readings", "equations"]:
    """Return where an effect acts: it adds time histories at disturbances of the model, or at readings, or changes its
    equations."""
    if effect.quasi_steady or (effect.series is not None and not effect.symbolic):
        return "disturbances"
    return "equations" if effect.symbolic else "readings"


def _of_histories(evidence: Evidence, rows: Sequence[_Row]) -> list[Fingerprint]:
    """The fingerprints of rows that are time histories by port."""
    base = evidence.fit
    together = COLUMNS
    parts = [rows[at : at + together] for at in range(0, len(rows), together)]
    if len(rows) <= len(evidence.newton):  # one pass for each is less than one for each parameter and small term

        def whole(some: Sequence[_Row]) -> list[Fingerprint]:
            return _fingerprints(evidence, some, _whitened(base, [_unit_history(base, *row) for row in some]))

        return [print_ for found in side_by_side(whole, parts) for print_ in found]

    # What enters where is the same for all rows of an effect.
    shown = {row[0].name: row for row in rows}.values()
    ports = dict.fromkeys(port for row in shown for port in _ports(base, row))
    entering = {port: np.empty((*base.white.shape[1::-1], len(evidence.newton) + 1)) for port in ports}
    for port, columns, part in _entrances(evidence, list(ports)):
        entering[port][..., columns] = part

    def summed(some: Sequence[_Row]) -> list[Fingerprint]:
        histories = [_unit_history(base, *row) for row in some]
        both = np.zeros((base.white.shape[1], len(evidence.newton) + 1, len(some)))
        for port, by_column in entering.items():
            at = [j for j, one in enumerate(histories) if port in one]
            if at:
                series = np.stack([histories[j][port] for j in at], axis=2).swapaxes(0, 1)
                acts = np.flatnonzero(series.any(axis=(0, 2)))  # events are nothing before they begin
                some_time = slice(acts[0], acts[-1] + 1) if len(acts) else slice(0)
                both[:, :, at] += by_column[:, some_time].swapaxes(1, 2) @ series[:, some_time]
        return _each(some, _squares(base, histories), both[:, 1:], both[:, 0])

    return [print_ for found in side_by_side(summed, parts) for print_ in found]


def _ports(base: FlightFit, row: _Row) -> Iterable[str]:
    """The ports at which an effect may enter."""
    if _acts_on(row[0]) == "readings":
        return [reading(name) for name in base.model.outputs]
    return _unit_history(base, *row)


def _fingerprints(evidence: Evidence, rows: Sequence[_Row], white: np.ndarray) -> list[Fingerprint]:
    """The fingerprints from whitened responses (N, R, ny, rows)."""
    square = np.einsum("krij,krij->rj", white, white)
    match = np.einsum("kri,krij->rj", evidence.fit.white, white)
    return _each(rows, square, evidence.products(white), match)


def _each(rows: Sequence[_Row], square: np.ndarray, cross: np.ndarray, match: np.ndarray) -> list[Fingerprint]:
    """The fingerprints from sums (R, rows), (R, k, rows) and (R, rows)."""
    return [
        Fingerprint(effect=e, values=v, onset=o, square=square[:, j], cross=cross[:, :, j], match=match[:, j])
        for j, (e, v, o) in enumerate(rows)
    ]


def responses(evidence: Evidence, rows: Sequence[_Row]) -> np.ndarray:
    """(N, R, ny, rows) Whitened responses to a unit of effects with these values and onsets.

    For an effect that is not linear it is the response to the complete effect.
    """
    base = evidence.fit
    known = [j for j, row in enumerate(rows) if _acts_on(row[0]) != "equations"]
    others = [j for j, row in enumerate(rows) if _acts_on(row[0]) == "equations"]
    white = np.zeros((*base.white.shape, len(rows)))
    if known:
        white[..., known] = _whitened(base, [_unit_history(base, *rows[j]) for j in known])
    if others:
        some = [rows[j] for j in others]
        white[..., others] = _white_of_equations(base, some, _symbolic_columns(base, [e for e, _, _ in some]))
    return white


def _symbolic_columns(base: FlightFit, effects: Sequence[Effect]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name -> (Y, F) of symbolic effects, from the Jacobians of a model that contains all of them at zero effect."""
    already = [a.effect for a in base.attached]
    effects = [e for e in effects if e.name not in {a.name for a in already}]
    if not effects:
        return {}
    model = base.flight.model([*already, *effects])
    P = np.tile(model.nominal_vector(), (len(base.batch.names), 1))
    P[:, [model.parameters.index(name) for name in base.model.parameters]] = base.parameters
    names = [e.name for e in effects]
    slopes = base.flight.functions(model).by_parameters(names)
    about = base.batch, P, base.linear.X, base.moving
    found = [(Dp, Bp) for _, Dp, Bp in slopes.in_stretches(*about, ends=base.ends)]
    Dp, Bp = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return {name: (Dp[..., i], Bp[..., i]) for i, name in enumerate(names)}


def _unit_history(base: FlightFit, effect: Effect, values: Mapping[str, float], onset: float | None) -> _History:
    """Port -> (N, R) time history of a unit of an effect, or of the complete effect on readings that is not linear."""
    if effect.quasi_steady:
        term = term_along(effect.regressor or "", base.regressors)
        return {str(effect.enters): np.broadcast_to(term, base.batch.live.shape)}
    one = _unit(effect, values, onset, base)
    names = base.batch.names
    t = base.batch.t
    if _acts_on(effect) == "disturbances":
        return station_series(one, names, t, base.known)
    change = readings([one], names, t, base.read, base.model.outputs, base.known) - base.read
    return _by_port([reading(name) for name in base.model.outputs], np.where(base.linear.seen, change, 0.0))


def largest_change(base: FlightFit, one: Attached) -> float:
    """Return the largest r.m.s. change of a reading by an effect, in units of its noise as recorded, along a simulation
    that no reading corrects; of an aircraft that only a controller keeps in the air, of its prediction."""
    ports = base.model.disturbances
    acts = _acts_on(one.effect)
    if acts == "equations":
        size = np.array([one.values["value"] * one.concerns(name) for name in base.batch.names])
        Y, F = (size[:, None] * column for column in _symbolic_columns(base, [one.effect])[one.name])
    elif acts == "disturbances":
        Y, F = (column.sum(axis=3) for column in inject(base.linear, range(len(ports)), history(base, one)))
    else:
        here = base.batch.names, base.batch.t
        Y = readings([one], *here, base.read, base.model.outputs, base.known) - base.read
        F = np.zeros(base.linear.defect.shape)
    kalman = base.filter if base.flight.by_innovations else base.filter.in_free_flight
    with np.errstate(over="ignore", invalid="ignore"):
        change = kalman.whiten(Y[..., None], F[..., None])[..., 0]
        square = np.sum(np.where(base.seen, change, 0.0) ** 2, axis=(0, 1))
    mean = square / np.maximum(base.seen.sum(axis=(0, 1)), 1) / base.flight.every
    return float(np.sqrt(np.max(np.where(np.isfinite(mean), mean, np.inf))))


def history(base: FlightFit, one: Attached) -> np.ndarray:
    """(N, R, nw) Time histories that an effect adds at the disturbances of a fit."""
    effect = one.effect
    if not effect.quasi_steady:
        return disturbance_series([one], base.batch.names, base.batch.t, base.known, base.model.disturbances)
    found = np.zeros((*base.batch.live.shape, len(base.model.disturbances)))
    size = np.array([one.values["value"] * one.concerns(name) for name in base.batch.names])
    found[..., base.model.disturbances.index(str(effect.enters))] = size * term_along(
        effect.regressor or "", base.regressors
    )
    return found


def _by_port(ports: Sequence[str], series: np.ndarray) -> _History:
    """Port -> (N, R) time history of those of (N, R, ports) that are not zero; the first port if all are. Copies: the
    whole is large.
    """
    acting = np.flatnonzero(series.any(axis=(0, 1))).tolist() or [0]
    return {ports[i]: series[..., i].copy() for i in acting}


def _squares(base: FlightFit, histories: Sequence[_History]) -> np.ndarray:
    """(R, histories) Sums of squares of the whitened responses."""
    ports, series, first = _joined(histories)
    if set(ports) <= set(base.model.disturbances):
        return base.filter.squares_of_histories([base.model.disturbances.index(p) for p in ports], series, first)
    return np.einsum("krij,krij->rj", *[white_at(base, ports, series, first)] * 2)


def _whitened(base: FlightFit, histories: Sequence[_History]) -> np.ndarray:
    """(N, R, ny, histories) Whitened responses to time histories by port."""
    return white_at(base, *_joined(histories))


def _joined(histories: Sequence[_History]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Port of each series, all series (N, R, number of series), and the index of the first series of each history."""
    series = np.stack([h for one in histories for h in one.values()], axis=2)
    parts = np.array([len(one) for one in histories])
    return [port for one in histories for port in one], series, np.cumsum(parts) - parts


def white_at(base: FlightFit, ports: Sequence[str], series: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(N, R, ny, n) Whitened responses to time histories (N, R, number of series) at ports, or to sums of them: from
    series number `first` (n,) of each sum to that of the next.
    """
    disturbances = base.model.disturbances
    of = np.searchsorted(first, np.arange(len(ports)), side="right") - 1
    read = [h for h, port in enumerate(ports) if port not in disturbances]
    others = [h for h, port in enumerate(ports) if port in disturbances]
    if not read:
        return base.filter.whiten_histories([disturbances.index(port) for port in ports], series, first)
    Y = np.zeros((*base.white.shape, len(first)))
    for h in read:
        channel = base.model.outputs.index(Station.at(ports[h]).name)
        Y[:, :, channel, of[h]] += np.where(base.linear.seen[:, :, channel], series[..., h], 0.0)
    white = base.filter.whiten(Y, np.zeros((*base.linear.defect.shape, len(first))))
    if others:
        columns, begin = np.unique(of[others], return_index=True)
        stations = [disturbances.index(ports[h]) for h in others]
        white[..., columns] += base.filter.whiten_histories(stations, series[..., others], begin)
    return white


def prints_of(evidence: Evidence, effect: Effect, histories: Iterable[np.ndarray]) -> list[Fingerprint]:
    """The fingerprints of time histories (N, R, nw) as those of an effect."""
    base = evidence.fit
    found = []
    following = (_by_port(base.model.disturbances, one) for one in histories)
    while some := list(islice(following, COLUMNS)):
        found += _fingerprints(evidence, [(effect, {}, None)] * len(some), _whitened(base, some))
    return found


def print_of(evidence: Evidence, one: Attached) -> tuple[Fingerprint, np.ndarray]:
    """The fingerprint of a unit of an effect with its other values and onsets, and the weights (R,) of the records in
    which it acts."""
    if one.effect.timed:
        prints = prints_of(evidence, one.effect, [history(evidence.fit, one.with_values({"value": 1.0}))])
    else:
        further = {key: value for key, value in one.values.items() if key != "value"}
        prints = fingerprints(evidence, [with_grid(one.effect, further)])
    return prints[0], np.array([float(one.concerns(name)) for name in evidence.fit.batch.names])


def _white_of_equations(base: FlightFit, rows: Sequence[_Row], symbolic: Mapping) -> np.ndarray:
    """(N, R, ny, rows) Whitened responses to effects in the equations of the model, from their Jacobians."""
    Y = np.zeros((*base.read.shape, len(rows)))
    F = np.zeros((*base.linear.defect.shape, len(rows)))
    for i, (effect, _, _) in enumerate(rows):
        if effect.name in symbolic:
            Y[..., i], F[..., i] = symbolic[effect.name]
    return base.filter.whiten(Y, F)


def _unit(effect: Effect, values: Mapping[str, float], onset: float | None, base: FlightFit) -> Attached:
    """The effect at unit amplitude in every record, with its onset counted from the first sample of each record."""
    onsets = {r.name: r.t[0] + onset for r in base.flight.records} if onset is not None else {}
    return Attached(effect=effect, values={"value": 1.0} | dict(values), onsets=onsets)
