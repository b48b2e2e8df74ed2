"""Whitened responses of a fitted aircraft to causes at unit amplitude."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from casid.diagnosis.evidence.fingerprints import symbolic_columns
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached, readings, station_series
from casid.model.station import coefficient
from casid.model.terms import parse_term


def responses(base: FlightFit, ones: Sequence[Attached]) -> list[np.ndarray]:
    """(N, R, ny) of each: to its whole where it is not linear, in every record that it concerns."""
    found: dict[int, np.ndarray] = {}
    histories = {i: history for i, one in enumerate(ones) if (history := _history(base, one)) is not None}
    for some in _parts(base, list(histories)):
        found |= dict(zip(some, _of_histories(base, [histories[i] for i in some]), strict=True))
    others = [i for i in range(len(ones)) if i not in histories]
    symbolic = symbolic_columns(base, [ones[i].effect for i in others if ones[i].effect.symbolic])
    for some in _parts(base, others):
        parts = [_direct(base, ones[i], symbolic) for i in some]
        Y, F = (np.stack([part[k] for part in parts], axis=3) for k in (0, 1))
        white = base.filter.whiten(Y, F)
        found |= {i: white[..., k].copy() for k, i in enumerate(some)}
    return [found[i] for i in range(len(ones))]


def _parts(base: FlightFit, of: Sequence[int]) -> Iterator[Sequence[int]]:
    together = base.flight.criteria.priors.numerics.responses
    return (of[first : first + together] for first in range(0, len(of), together))


def _history(base: FlightFit, one: Attached) -> Mapping[str, np.ndarray] | None:
    """Disturbance station -> (N, R) time history; None for what is none."""
    effect = one.effect
    if effect.quasi_steady:
        series = np.broadcast_to(parse_term(effect.regressor or "0").evaluate(base.regressors), base.batch.live.shape)
        mask = np.array([one.concerns(name) for name in base.batch.names], dtype=float)
        return {coefficient(effect.target): series * mask}
    if effect.series is None or effect.symbolic:
        return None
    return station_series(one, base.batch.names, base.batch.t, base.known)


def _of_histories(base: FlightFit, histories: Sequence[Mapping[str, np.ndarray]]) -> list[np.ndarray]:
    index, nothing = base.model.disturbances.index, np.zeros(base.batch.live.shape)
    acting = [{s: h for s, h in one.items() if h.any()} for one in histories]
    acting = [one or {next(iter(base.model.disturbances)): nothing} for one in acting]
    stations = [index(station) for one in acting for station in one]
    series = np.stack([history for one in acting for history in one.values()], axis=2)
    sizes = np.array([len(one) for one in acting])
    white = base.filter.whiten_histories(stations, series, np.cumsum(sizes) - sizes)
    return [white[..., k].copy() for k in range(len(histories))]


def _direct(
    base: FlightFit, one: Attached, symbolic: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """(Y, F) of an effect in the model's equations, or on readings."""
    still = np.zeros(base.linear.defect.shape)
    mask = np.array([one.concerns(name) for name in base.batch.names], dtype=float)
    if one.effect.symbolic:
        Y, F = symbolic.get(one.name, (np.zeros(base.read.shape), still))
        return Y * mask[None, :, None], F * mask[None, :, None]
    there = one.name in {a.name for a in base.attached}
    plain = base.linear.output if there else base.read
    read = readings([one], base.batch.names, base.batch.t, plain, base.model.outputs, base.known)
    return np.where(base.linear.seen, read - plain, 0.0), still
