"""Noise whose 1-sigma is a formula, or that is log-normal: the problem in which it is a sum of squares, and back.

-ln(likelihood) is the sum of r^2/(2 s^2) + ln s with the residual r and a 1-sigma s of parameters and outputs. Both
terms become squares of outputs with a noise of one: r/s, and sqrt(2 ln(s/s0) + c), of which half the square is ln s but
for a constant. With s0 at the solution and c = 1 their information is that of Fisher, and Gauss-Newton is his scoring;
from a start, where s0 is not yet known, c leaves room for a 1-sigma that falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.estimation.fit import Fit
from casid.estimation.fitted import channel_fits
from casid.estimation.noise import Noise
from casid.estimation.problem import Problem
from casid.estimation.uncertainty import Rescaled
from casid.records.record import Record

_ROOM = 1e4  # times less than at the start that a 1-sigma may become before it is referred to anew
_LEAST = 1e-6  # of the smallest reading: what a log-normal output below is taken for by a tangent
_RANGE = 0.05  # of a channel's range: a 1-sigma where the formula has none at the start
_LINE = "noise in units of its formula: {}"
_SPREAD = "spread of the noise: {}"
_READING = "reading of {}"
_REFERENCE = "reference of {}"


def solved_with_formulas(problem: Problem, solved: Callable[[Problem], Fit], again: Callable[[Problem], Fit]) -> Fit:
    """The fit of a problem with noise by formula: `solved` as a sum of squares and, `again` from there, with every
    1-sigma referred to its own value."""
    problem, remark = _with_smaller_noise(problem)
    first = _at_start(problem)
    fit = solved(first.problem)
    fit = replace(fit, way="; ".join(filter(None, (remark, fit.way))))
    if not fit.converged:
        return first.returned(fit)
    found = first.returned(fit)
    closer = _referred(problem, first.sigma(fit), 1.0, found.values)
    ended = again(closer.problem)
    if not ended.converged:
        return found
    better = closer.returned(ended)
    iterations = fit.iterations + ended.iterations
    seconds = fit.seconds + ended.seconds
    return replace(better, way=fit.way, iterations=iterations, seconds=seconds)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Squares:
    """`posed` as the sum of squares `problem`; `reference` record -> output -> (N,) 1-sigma s0, and `room` the c."""

    posed: Problem
    problem: Problem
    reference: Mapping[str, Mapping[str, np.ndarray]]
    room: float

    def sigma(self, fit: Fit) -> dict[str, dict[str, np.ndarray]]:
        """Record -> output -> (N,) 1-sigma at a fit of `problem`."""
        outputs = self.problem.model.outputs
        found = {record: dict(of) for record, of in self.reference.items()}
        for name in self.posed.noise_formulas:
            spread = _SPREAD.format(name)
            for record in found if spread in fit.channels else ():
                root = fit.predictions[record][:, outputs.index(spread)]
                found[record][name] = self.reference[record][name] * np.exp(0.5 * (root**2 - self.room))
        return found

    def returned(self, fit: Fit) -> Fit:
        """The fit of `problem` as one of `posed`: outputs, noise and likelihood of what was measured."""
        posed = self.posed
        inner = self.problem.model.outputs
        sizes = self.sigma(fit)
        measured = {record.name: posed.outputs_of(record) for record in posed.records}
        predictions = {record: np.empty_like(z) for record, z in measured.items()}
        squares: dict[str, list[np.ndarray]] = {}
        cost = fit.cost
        likelihood = fit.log_likelihood
        for i, name in enumerate(posed.model.outputs):
            noise = posed.noise_formulas.get(name)
            if noise is None:
                for record, y in predictions.items():
                    y[:, i] = fit.predictions[record][:, inner.index(name)]
                continue
            squares[name] = []
            for record in posed.records:
                own = fit.predictions[record.name]
                sigma = sizes[record.name][name]
                reference = self.reference[record.name][name]
                reading, present = _reading(record, name, noise)
                at = (own[:, inner.index(_LINE.format(name))] - reading / reference) * sigma + reading
                predictions[record.name][:, i] = np.exp(at) if noise.logarithmic else at
                spread = fit.residuals[record.name][:, inner.index(_SPREAD.format(name))][present]
                cost -= 0.5 * float((spread**2).sum())
                likelihood += float((0.5 * spread**2 + 0.5 * math.log(2.0 * math.pi)).sum())
                likelihood -= float(np.log(sigma[present]).sum())
                if noise.logarithmic:
                    likelihood -= float(np.log(measured[record.name][present, i]).sum())
                squares[name].append(sigma[present] ** 2)
        channels = channel_fits(posed.model.outputs, measured, predictions)
        found = {name: fit.noise.get(name, math.nan) for name in channels}
        found |= {n: float(np.sqrt(np.mean(np.concatenate(s)))) for n, s in squares.items() if n in channels}
        return replace(
            fit,
            problem=posed,
            uncertainty=Rescaled(fit.uncertainty, np.ones(len(posed.parameters)), coloured=False),
            cost=cost,
            log_likelihood=likelihood,
            predictions=predictions,
            residuals={record: z - predictions[record] for record, z in measured.items()},
            channels=channels,
            noise=found,
            noise_covariance=np.diag([found.get(n, np.nan) ** 2 for n in posed.model.outputs]),
        )


def _reading(record: Record, name: str, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the reading on the scale of its noise, zero where it is missing, and whether it is present."""
    reading = record[name] if name in record else np.full(len(record), np.nan)
    present = np.isfinite(reading)
    filled = np.where(present, reading, 1.0)
    return np.where(present, np.log(filled) if noise.logarithmic else filled, 0.0), present


def _with_smaller_noise(problem: Problem) -> tuple[Problem, str]:
    """The problem where no noise begins beyond the range of its readings, and what was changed. There the readings
    determine no parameter, and an iteration has no direction."""
    model = problem.model
    start = dict(problem.start)
    said = list[str]()
    in_motion = ca.vertcat(model.f, model.h, *model.events.values(), *model.initial.values())
    elsewhere = ca.which_depends(in_motion, model.p, 1, False)
    for name, noise in problem.noise_formulas.items():
        if isinstance(noise.sigma, str):
            continue
        sigma = noise.expression(model, name)
        used = ca.which_depends(sigma, model.p, 1, False)
        own = [i for i, (u, e) in enumerate(zip(used, elsewhere, strict=True)) if u and not e]
        of_noise = {model.parameters[i] for i in own}
        names = [n for n, bare in zip(problem.parameters, problem.bare, strict=True) if bare in of_noise]
        larger = model.p[:]
        for i in own:
            larger[i] = 2.0 * model.p[i]
        sizes = problem.at_guess(ca.vertcat(sigma, ca.substitute(sigma, model.p, larger)))
        readings = [_reading(record, name, noise) for record in problem.records]
        read = np.concatenate([reading[present] for reading, present in readings])
        one, two = np.concatenate([rows[present] for rows, (_, present) in zip(sizes, readings, strict=True)]).T
        spread = float(np.ptp(read)) if len(read) else 0.0
        if not names or not spread > 0.0 or not np.isfinite(one).all() or not np.allclose(two, 2.0 * one, rtol=1e-9):
            continue
        times = float(np.median(one)) / spread
        if times > 1.0:
            before = problem.named(problem.start_vector)
            start |= {n: before[n] / times for n in names}
            said.append(
                f"start: the noise of {name} is {times:.2g} times the range of its readings; the search began with "
                f"{', '.join(f'{n} = {start[n]:.3g}' for n in names)}"
            )
    return replace(problem, start=start), "; ".join(said)


def _at_start(problem: Problem) -> _Squares:
    """Evaluate every 1-sigma at the start values, at the readings."""
    reference: dict[str, dict[str, np.ndarray]] = {record.name: {} for record in problem.records}
    for name, noise in problem.noise_formulas.items():
        if isinstance(noise.sigma, str):
            sigmas = [record[noise.sigma] for record in problem.records]
        else:
            sigmas = [rows[:, 0] for rows in problem.at_guess(noise.expression(problem.model, name))]
        for record, sigma in zip(problem.records, sigmas, strict=True):
            reading, present = _reading(record, name, noise)
            spread = float(np.ptp(reading[present])) if present.any() else 1.0
            usual = _RANGE * spread if spread > 0.0 else 1.0
            good = np.isfinite(sigma) & (sigma > 0.0)
            middle = float(np.median(sigma[good])) if good.any() else usual
            reference[record.name][name] = np.where(good, sigma, middle)
    return _referred(problem, reference, 1.0 + 2.0 * math.log(_ROOM), {})


def _referred(
    problem: Problem,
    reference: Mapping[str, Mapping[str, np.ndarray]],
    room: float,
    start: Mapping[str, float],
) -> _Squares:
    """The sum of squares with these 1-sigma s0 and this c."""
    formulas = problem.noise_formulas
    model = problem.model
    further = [_READING.format(n) for n in formulas] + [_REFERENCE.format(n) for n in formulas]
    channels = [n.sigma for n in formulas.values() if isinstance(n.sigma, str) and n.sigma not in model.inputs]
    inputs = (*model.inputs, *further, *dict.fromkeys(channels))
    u = ca.vertcat(model.u, ca.SX.sym("more", len(inputs) - len(model.inputs)))
    symbols = dict(zip(inputs, ca.vertsplit(u), strict=True)) if inputs else {}
    rows = []
    outputs = []
    for i, name in enumerate(model.outputs):
        if name not in formulas:
            rows.append(model.h[i])
            outputs.append(name)
            continue
        noise = formulas[name]
        sigma = symbols[noise.sigma] if isinstance(noise.sigma, str) else noise.expression(model, name)
        reading = symbols[_READING.format(name)]
        size = symbols[_REFERENCE.format(name)]
        h = _logarithm(model.h[i], _least(problem, name)) if noise.logarithmic else model.h[i]
        # measured as reading / s0: the same residual as zero, and the channel keeps its range
        rows += [(h - reading) / sigma + reading / size, ca.sqrt(2.0 * ca.log(sigma / size) + room)]
        outputs += [_LINE.format(name), _SPREAD.format(name)]
    given_noise = problem.noise if isinstance(problem.noise, Mapping) else {}
    plain = {name: value for name, value in given_noise.items() if name not in formulas}
    unit = dict.fromkeys((o for o in outputs if o not in model.outputs), 1.0)
    inner = replace(model, inputs=inputs, u=u, outputs=tuple(outputs), h=ca.vertcat(*rows), equation=None)
    records = [_with_readings(record, problem, reference[record.name]) for record in problem.records]
    found = replace(
        problem, model=inner, records=records, noise={**plain, **unit}, start={**problem.start, **start}, measured={}
    )
    return _Squares(posed=problem, problem=found, reference=reference, room=room)


def _with_readings(record: Record, problem: Problem, sigma: Mapping[str, np.ndarray]) -> Record:
    """The record with what the outputs of the sum of squares are measured as."""
    added = {}
    for name, noise in problem.noise_formulas.items():
        reading, present = _reading(record, name, noise)
        added[_REFERENCE.format(name)] = sigma[name]
        added[_READING.format(name)] = reading
        added[_LINE.format(name)] = np.where(present, reading / sigma[name], np.nan)
        added[_SPREAD.format(name)] = np.where(present, 0.0, np.nan)
        if isinstance(noise.sigma, str):
            added[noise.sigma] = np.where(record[noise.sigma] > 0.0, record[noise.sigma], 1.0)
    return record.with_channels(**added)


def _least(problem: Problem, name: str) -> float:
    read = np.concatenate([record[name] for record in problem.records if name in record] or [np.ones(1)])
    return _LEAST * float(np.nanmin(read))


def _logarithm(value: ca.SX, least: float) -> ca.SX:
    """ln(value), below `least` its tangent there: a motion on the way to the solution may leave the range."""
    return ca.if_else(
        value > least, ca.log(ca.if_else(value > least, value, least)), value / least - 1.0 + math.log(least)
    )
