"""The columns of a fitted model for the score: what parameters, ports and causes do to the whitened residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.explanations.explanation import CauseColumn, Entrance, RecordColumns, WhitenedInnovations
from casid.diagnosis.explanations.explanation import HistoryPort as Place
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.systems.cause import CandidateCause, PartOfModel, Run
from casid.diagnosis.systems.fit import Fitted, Question
from casid.diagnosis.systems.library import Library, onsets
from casid.filtering.innovations import Batch, Linear, NoiseModel, PointFunctions, at_points, linearise, make_batch
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.model.port import ModelPort as Port
from casid.model.port import with_ports
from casid.native.compiler import Compilable
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class SystemEvidence:
    """The innovations of a fitted model, and of each cause's column what it would be as a part of the model.

    matters  disturbance -> size that matters there;  log_determinant  see `WhitenedInnovations`
    """

    innovations: WhitenedInnovations
    attachable: tuple[PartOfModel, ...]
    matters: dict[str, float]
    runs: tuple[Run, ...]
    priors: Priors


@dataclass(frozen=True, eq=False, kw_only=True)
class _Along:
    """A fitted model linearised along its records, with its ports."""

    ports: tuple[Port, ...]
    records: tuple[Record, ...]
    batch: Batch
    linear: Linear
    filter: Filter
    runs: tuple[Run, ...]
    matters: dict[str, float]
    criteria: Criteria


def columns_of(
    found: Fitted, question: Question, ports: Sequence[Port], causes: Sequence[CandidateCause], library: Library
) -> SystemEvidence:
    """Linearise a fit, whiten everything, and state the priors."""
    along = _along(found, question, tuple(ports), library)
    span = float(np.median([r.duration for r in along.records]))
    criteria = question.criteria
    times = tuple(share * span for share in criteria.systems.times)
    priors = replace(criteria.priors, times=times, base=criteria.systems.base)
    free = along.linear.free
    prior_std = np.array([found.model.prior_std.get(name, np.inf) for name in free])
    nominal = np.array([found.model.nominal[name] for name in free])
    value = np.array([found.values[name] for name in free])
    columns, attachable, shapes = _causes(along, found, causes, priors)
    white = along.filter.whiten(*residual_column(along.linear))[..., 0]
    nuisance = along.filter.whiten(along.linear.Dp, along.linear.Bp)
    histories, nodes = _histories(along)
    records = []
    for r, record in enumerate(along.records):
        n = len(record)
        seen = along.linear.seen[:n, r]
        records.append(
            RecordColumns(
                residual=white[:n, r][seen],
                nuisance=nuisance[:n, r][seen],
                small=np.zeros((int(seen.sum()), 0)),
                histories=tuple(h[:n, r][seen] for h in histories),
                shapes=shapes[:n, r][seen],
                nodes=nodes[r],
            )
        )
    innovations = WhitenedInnovations(
        records=tuple(records),
        precision=prior_std**-2.0,
        pull=(value - nominal) * prior_std**-2.0,
        ports=tuple(Place(name=p.disturbance, matters=along.matters[p.disturbance]) for p in ports),
        entrances=tuple(
            Entrance(name=p.disturbance, ports=(p.disturbance,), log_prior=priors.unknown(len(ports))) for p in ports
        ),
        causes=columns,
        log_determinant=float(np.sum(along.filter.log_determinant * along.batch.live)),
    )
    return SystemEvidence(
        innovations=innovations, attachable=attachable, matters=along.matters, runs=along.runs, priors=priors
    )


def _along(found: Fitted, question: Question, ports: tuple[Port, ...], library: Library) -> _Along:
    model = with_ports(found.model, ports)
    free = (*question.free, *(one.name for one in found.extended.attached))
    batch, functions = make_batch(model, found.records), PointFunctions(model, free)
    X = np.zeros((*batch.live.shape, len(model.states)))
    for r, record in enumerate(found.records):
        trajectory = found.fit.states[record.name].trajectory
        X[: len(record), r], X[len(record) :, r] = trajectory, trajectory[-1]
    P = np.tile([found.values[name] for name in model.parameters], (len(found.records), 1))
    linear = linearise(functions, batch, P, X)
    runs, rates = _runs(found, batch, linear, P, library)
    matters = {}
    for port in ports:
        if port.matters is not None:
            matters[port.disturbance] = port.matters
            continue
        if port.kind == "state derivative":
            i = model.states.index(port.name)
            there = np.concatenate([rates[: len(r), k, i] for k, r in enumerate(found.records)])
        elif port.kind == "input":
            there = np.concatenate([run.inputs[port.name] for run in runs])
        else:
            there = np.concatenate([run.outputs[port.name] for run in runs])
        matters[port.disturbance] = max(question.criteria.size.share * float(np.std(there)), 1e-12)
    return _Along(
        ports=ports,
        records=found.records,
        batch=batch,
        linear=linear,
        filter=kalman_filter(linear, NoiseModel(measurement=question.noise)),
        runs=runs,
        matters=matters,
        criteria=question.criteria,
    )


def _runs(
    found: Fitted, batch: Batch, linear: Linear, P: np.ndarray, library: Library
) -> tuple[tuple[Run, ...], np.ndarray]:
    """Of every record what acts in it and what it reads, and the state derivatives (N, R, nx)."""
    base, model = found.extended.base, found.model
    U = batch.U[..., : len(base.inputs)].copy()
    for one in found.extended.attached:
        if one.slope is not None:
            slope = batch.U[..., model.inputs.index(one.slope)]
            U[..., base.inputs.index(one.cause.target)] += found.values[one.name] * slope
    terms = library.terms(base)
    of_terms = Compilable(ca.Function("terms", [base.x, base.u], [ca.densify(ca.vertcat(*terms.values()))]))
    value = (
        at_points(of_terms, linear.X[..., : len(base.states)], U)[0][..., 0] if terms else np.zeros((*U.shape[:2], 0))
    )
    of_rates = Compilable(ca.Function("rates", [model.x, model.u, model.p, model.w], [ca.densify(model.f)]))
    rates = at_points(of_rates, linear.X, batch.U, P, np.zeros((*batch.live.shape, len(model.disturbances))))[0][..., 0]
    runs = [
        Run(
            t=record.t,
            inputs={name: U[: len(record), r, j] for j, name in enumerate(base.inputs)},
            outputs={name: linear.output[: len(record), r, i] for i, name in enumerate(base.outputs)},
            terms={name: value[: len(record), r, k] for k, name in enumerate(terms)},
        )
        for r, record in enumerate(found.records)
    ]
    return tuple(runs), rates


def _histories(along: _Along) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per port (N, R, ny, nodes) whitened responses to a unit at each node, and the nodes' times of each record."""
    (N, R), intervals = along.batch.live.shape, along.criteria.systems.nodes
    nodes = [np.linspace(r.t[0], r.t[-1], intervals + 1) for r in along.records]
    series = np.zeros((N, R, intervals + 1))
    for r, record in enumerate(along.records):
        unit = np.eye(intervals + 1)
        series[: len(record), r] = np.stack(
            [np.interp(record.t, nodes[r], unit[k]) for k in range(intervals + 1)], axis=1
        )
    found = []
    for port in along.ports:
        station = along.linear.model.disturbances.index(port.disturbance)
        white = along.filter.whiten_histories([station] * (intervals + 1), series)
        found.append(white.astype(np.float32))
    return found, [at - at[0] for at in nodes]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shape:
    """A column, and what its cause would be in the model: amplitude mean and scales, size at unit amplitude."""

    attached: PartOfModel
    histories: dict[int, np.ndarray]
    mean: float
    scales: tuple[float, ...]
    matters: float
    value: float


def _causes(
    along: _Along, found: Fitted, causes: Sequence[CandidateCause], priors: Priors
) -> tuple[tuple[CauseColumn, ...], tuple[PartOfModel, ...], np.ndarray]:
    """The columns of all causes, and their whitened responses (N, R, ny, columns)."""
    kinds = {cause.kind for cause in causes}
    shapes: list[_Shape] = []
    for cause in causes:
        alternatives = sum(other.kind == cause.kind for other in causes)
        made = list(_shapes(along, found, cause, priors))
        log_prior = priors.cause(len(kinds), alternatives * max(len(made), 1))
        shapes += [replace(one, attached=replace(one.attached, log_prior=log_prior)) for one in made]
    N, R = along.batch.live.shape
    stations, series, responses = [], [], []
    for one in shapes:
        if one.attached.cause.port is not None:
            column = np.zeros((N, R))
            for r, history in one.histories.items():
                column[: len(history), r] = history
            stations.append(along.linear.model.disturbances.index(one.attached.cause.port))
            series.append(column)
    by_history = along.filter.whiten_histories(stations, np.stack(series, axis=2)) if series else None
    by_parameter = along.filter.whiten(along.linear.Dp, along.linear.Bp)
    k = 0
    for one in shapes:
        if one.attached.cause.port is None:
            responses.append(by_parameter[..., along.linear.free.index(one.attached.cause.target)])
        elif by_history is not None:
            responses.append(by_history[..., k])
            k += 1
    columns = tuple(
        CauseColumn(
            name=one.attached.name,
            kind=one.attached.cause.kind,
            shape=dict.fromkeys(one.histories, j),
            mean=one.mean,
            scales=one.scales,
            log_prior=one.attached.log_prior,
            matters=one.matters,
            value=one.value,
        )
        for j, one in enumerate(shapes)
    )
    white = np.stack(responses, axis=-1) if responses else np.zeros((N, R, along.linear.C.shape[2], 0))
    return columns, tuple(one.attached for one in shapes), white


def _subsets(cause: CandidateCause, records: Sequence[Record]) -> list[tuple[int, ...]]:
    """Sets of records that may have a cause: all, each, and all from one on."""
    every = tuple(range(len(records)))
    found = [every] if cause.everywhere else []
    if cause.somewhere and len(records) > 1:
        found += [(r,) for r in every] + [every[r:] for r in every[1:-1]]
    return found


def _shapes(along: _Along, found: Fitted, cause: CandidateCause, priors: Priors):
    records = along.records
    if cause.onset:
        yield from _stuck(along, cause, priors)
        return
    for subset in _subsets(cause, records):
        names = () if len(subset) == len(records) else tuple(records[r].name for r in subset)
        if cause.port is None:
            least = along.criteria.size.share * max(abs(found.values[cause.target]), 1e-12)
            histories = dict.fromkeys(subset, np.zeros(0))
            yield _linear(cause, names, histories, least, priors)
        elif not cause.grid and cause.history is not None:
            histories = {r: cause.history(along.runs[r], 1.0) for r in subset}
            varies = float(np.std(np.concatenate(list(histories.values()))))
            # a constant shifts by all of itself, everything else by its variation
            size = varies if varies > 1e-9 * _rms(histories) else _rms(histories)
            if size > 0.0:
                yield _linear(cause, names, histories, along.matters[cause.port] / size, priors)
        elif cause.history is not None:
            for value, spread in cause.grid:
                histories = {r: cause.history(along.runs[r], value) for r in subset}
                if (size := _rms(histories)) > 0.0:
                    attached = PartOfModel(
                        cause=cause, value=value, centre=value, spread=spread, records=names, log_prior=0.0
                    )
                    yield _Shape(
                        attached=attached,
                        histories=histories,
                        mean=1.0,
                        scales=(priors.grid,),
                        matters=along.matters[cause.port] / size,
                        value=value,
                    )


def _linear(
    cause: CandidateCause, names: tuple[str, ...], histories: dict[int, np.ndarray], least: float, priors: Priors
) -> _Shape:
    """Amplitudes are in units of what matters; its spread as a part of the model is set when it is put there."""
    attached = PartOfModel(
        cause=cause, value=0.0, centre=0.0, spread=least, matters=least, records=names, log_prior=0.0
    )
    scales = tuple(s * least for s in priors.sizes)
    return _Shape(attached=attached, histories=histories, mean=0.0, scales=scales, matters=least, value=1.0)


def _stuck(along: _Along, cause: CandidateCause, priors: Priors):
    """A reading that stays where it was, from each of some times on, in one record."""
    for r, record in enumerate(along.records):
        if cause.target not in record:
            continue
        reads = along.runs[r].outputs[cause.target]
        for onset in onsets(record, along.criteria.systems.onsets):
            begin = int(np.searchsorted(record.t, onset))
            history = np.where(np.arange(len(record)) >= begin, reads[begin] - reads, 0.0)
            if not (size := _rms({r: history})) > 0.0:
                continue
            spread = cause.grid[0][1]
            attached = PartOfModel(
                cause=cause,
                value=float(reads[begin]),
                centre=cause.grid[0][0],
                spread=spread,
                onset_s={record.name: float(onset)},
                log_prior=0.0,
            )
            yield _Shape(
                attached=attached,
                histories={r: history},
                mean=1.0,
                scales=(priors.grid,),
                matters=along.matters[str(cause.port)] / size,
                value=float(reads[begin]),
            )


def _rms(histories: dict[int, np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(histories.values())) ** 2)))
