"""The innovations of a fitted aircraft, and the columns of all that could be in them, as the score weighs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from casid.diagnosis.evidence.coefficients import coefficient_series
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.missing_input import response, stations
from casid.diagnosis.explanations.explanation import (
    CauseColumn,
    Entrance,
    HistoryPort,
    RecordColumns,
    WhitenedInnovations,
)
from casid.diagnosis.explanations.pool import Competitor, unit_of
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.responses import responses
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.numerics import ScoreNumerics
from casid.model.causes import input_delay, sensor_bias
from casid.model.station import reading, wind
from casid.signals import SURFACES

TURBULENCE = "turbulence"
WINDS = tuple(map(wind, "xyz"))


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightColumns:
    """Whitened innovations; of each column the effect that it stands for, at unit amplitude or as attached."""

    innovations: WhitenedInnovations
    fit: FlightFit
    ones: tuple[Attached, ...]


def flight_columns(
    evidence: Evidence, found: Sequence[Competitor], priors: Priors, own: Mapping[str, CauseColumn]
) -> FlightColumns:
    """Innovations and columns of a fit.

    own  name of an attached effect that is to compete as a cause -> the column that it was found as
    """
    base = evidence.fit
    attached = [one for one in base.attached if one.name in own]
    slots = _slots(base, attached)
    columns = [_own_column(base, one, own[one.name], priors) for one in attached]
    ones, white, which = [*attached], _own_responses(base, attached), list(range(len(attached)))
    known: dict[object, int] = {}
    wanted: list[Attached] = []
    for c in found:
        key = c.one.name, tuple(sorted(c.one.onsets.items())), tuple(sorted(c.one.values.items()))
        if key not in known:
            known[key] = len(white) + len(wanted)
            wanted.append(replace(c.one, records=()))
        which.append(known[key])
        ones.append(c.one)
        columns.append(c.column)
    white += responses(base, wanted)
    names = base.batch.names
    causes = tuple(
        replace(column, shape={r: w for r, name in enumerate(names) if one.concerns(name)})
        for column, one, w in zip(columns, ones, which, strict=True)
    )
    levels = _levels(base)
    late, there = _late(base), [i for i in range(len(base.slots)) if i not in slots]
    spacing = max(priors.numerics.spacing, sum(r.duration for r in base.flight.records) / priors.numerics.most_nodes)
    records = _records(evidence, there, late, white, list(levels), spacing)
    for r, one in enumerate(records):  # what is attached competes: its response goes back to what is to be explained
        for column, attached_one in zip(causes, attached, strict=False):
            if r in column.shape:
                one.residual[:] += _size(attached_one) * one.shapes[:, column.shape[r]]
    return FlightColumns(
        innovations=WhitenedInnovations(
            records=tuple(records),
            precision=np.append(
                _precision(base, there, priors.numerics), [3.0] * len(late)
            ),  # uniform between a sample early and late
            pull=np.append(base.prior_pull[there], [0.0] * len(late)),
            small_information=evidence.small_information,
            owners=tuple(owner for owner, _ in evidence.terms),
            ports=tuple(HistoryPort(name=name, matters=level) for name, level in levels.items()),
            entrances=_entrances(base, list(levels), priors),
            causes=causes,
            log_determinant=base.data_deviance - float(np.sum(base.white**2)),
        ),
        fit=base,
        ones=tuple(ones),
    )


def _slots(base: FlightFit, attached: Sequence[Attached]) -> list[int]:
    """The slots that the effects which compete have in the fit."""
    names = {one.name for one in attached}
    return [i for i, slot in enumerate(base.slots) if slot.name in names]


def _size(one: Attached) -> float:
    return one.values["value"] if _is_linear(one) else 1.0


def _is_linear(one: Attached) -> bool:
    return one.effect.linear and not one.effect.members


def _own_responses(base: FlightFit, attached: Sequence[Attached]) -> list[np.ndarray]:
    """Of what is linear the fitted sensitivity, of the rest the response to its whole."""
    whole = iter(responses(base, [one for one in attached if not _is_linear(one)]))
    names = [slot.name for slot in base.slots]
    return [base.columns[..., names.index(one.name)] if _is_linear(one) else next(whole) for one in attached]


def _own_column(base: FlightFit, one: Attached, column: CauseColumn, priors: Priors) -> CauseColumn:
    """The column of an effect that is in the fit, with the prior that it was found with."""
    matters = unit_of(base, one)["matters"]
    if _is_linear(one):
        scales = tuple(matters * s for s in priors.sizes) if np.isfinite(matters) else column.scales
        return replace(column, mean=0.0, scales=scales, matters=matters, value=1.0)
    share = unit_of(base, one)["share"]
    return replace(column, mean=1.0, scales=(priors.grid,), matters=1.0 / max(share, 1e-12), value=one.values["value"])


def _precision(base: FlightFit, there: Sequence[int], numerics: ScoreNumerics) -> np.ndarray:
    """Of the nuisance: of the further values of an attached effect, as loose as they are known."""
    precision = base.prior_weight[there].copy()
    for i, at in enumerate(there):
        slot = base.slots[at]
        if slot.attached is not None and slot.key != "value":
            precision[i] = max(numerics.further * abs(base.values[at]), numerics.smallest_further) ** -2.0
    return precision


def _late(base: FlightFit) -> list[np.ndarray]:
    """The response to all inputs acting half a sample late: how they run between samples is not known."""
    half = 0.5 * float(np.median(base.batch.dt))
    there = {a.name for a in base.attached}
    delays = {input_delay(surface).name for surface in SURFACES}
    effects = [e for e in base.flight.effects if e.name in delays]
    late = responses(base, [Attached(effect=e, values={"value": half}) for e in effects if e.name not in there])
    return [np.sum(late, axis=0)] if late else []


def _levels(base: FlightFit) -> dict[str, float]:
    """Port -> level that matters there: a share of a coefficient's or reading's variation, or of a wind; of a reading,
    its smallest bias that matters, if that is more."""
    live, coefficients, found, size = base.batch.live, coefficient_series(base), {}, base.criteria.size
    for station in stations(base):
        if station in WINDS:
            found[station] = size.share * (size.wind_along if station == "wind_x" else size.wind_across)
        else:
            found[station] = size.share * max(float(np.std(coefficients[station[1:]][live])), 1e-12)
    for i, output in enumerate(base.model.outputs):
        bias = sensor_bias(output).smallest_that_matters(base.flight.aircraft) or 0.0
        found[reading(output)] = max(size.share * float(np.std(base.read[..., i][live])), bias)
    return found


def _entrances(base: FlightFit, ports: Sequence[str], priors: Priors) -> tuple[Entrance, ...]:
    """One at every port, and moving air along all axes, where the filter has none: that is a cause of the catalogue."""
    single = [Entrance(name=p, ports=(p,), log_prior=priors.unknown(len(ports))) for p in ports]
    winds = tuple(p for p in ports if p in WINDS)
    if len(winds) < 2 or base.noise.coloured:
        return tuple(single)
    kinds = len({e.kind for e in base.flight.effects})
    return (*single, Entrance(name=TURBULENCE, ports=winds, log_prior=priors.cause(kinds)))


def _records(
    evidence: Evidence,
    there: Sequence[int],
    late: Sequence[np.ndarray],
    white: Sequence[np.ndarray],
    ports: Sequence[str],
    spacing: float,
) -> list[RecordColumns]:
    base, k = evidence.fit, len(evidence.fit.slots)
    nodes = [np.arange(0.0, record.duration + spacing, spacing) for record in base.flight.records]
    longest = max(nodes, key=len)
    since = base.batch.t - base.batch.t[0]
    hats = np.maximum(0.0, 1.0 - np.abs(since[..., None] - longest) / spacing) * base.batch.live[..., None]
    steps = [_steps(base, r, base.criteria.priors.numerics.step * spacing) for r in range(len(nodes))]
    histories: list[list[np.ndarray]] = [[] for _ in nodes]
    for port in ports:
        entered = response(base, port, hats)
        for r, n in enumerate(nodes):
            histories[r].append((steps[r] @ entered[:, r, :, : len(n)].reshape(-1, len(n))).astype(np.float32))
    found = []
    for r, n in enumerate(nodes):
        flat = evidence.by_record[r]
        beside = [one[:, r].reshape(-1, 1) for one in late]
        found.append(
            RecordColumns(
                residual=base.white[:, r].reshape(-1).copy(),
                nuisance=np.hstack([flat[:, list(there)], *beside]),
                small=flat[:, k:],
                histories=tuple(histories[r]),
                shapes=np.stack([w[:, r].reshape(-1) for w in white], axis=1) if white else np.zeros((len(flat), 0)),
                nodes=n,
                steps=steps[r],
            )
        )
    return found


def _steps(base: FlightFit, r: int, length: float) -> csr_array:
    """The steps in time of the readings of a record: of each channel those that were read within `length`, together."""
    seen = base.linear.seen[:, r]
    samples = max(1, int(length / base.flight.records[r].dt + 1e-6))
    channels = seen.shape[1]
    step = (np.arange(len(seen)) // samples)[:, None] * channels + np.arange(channels)
    rows, number = np.flatnonzero(seen), step[seen]
    count = np.bincount(number, minlength=int(step.max()) + 1)
    weight = 1.0 / np.sqrt(count[number])
    return csr_array((weight, (number, rows)), shape=(len(count), seen.size))
