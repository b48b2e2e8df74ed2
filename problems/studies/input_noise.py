"""Errors in the inputs: what noise of the measured surfaces does to the estimates.

An output-error fit takes its inputs as exact. Noise n_j of an input at sample j moves the predicted outputs, and with
them the gradient of the cost by G_j' n_j. G_j comes from one backward pass (adjoint) over the fit's linearised
system with the states re-estimated. The estimate moves by the inverse information times that, so that

    cov = I^-1 (sum_ij J_i' W R(i-j) W J_j + sum_j G_j' S G_j) I^-1

with the autocovariance R of the measurement noise and the input noise S. First order in the noise: the attenuation of
estimates by errors in variables, of second order, is not in it.

With the states at the start of every segment eliminated, the passes over one segment need nothing of another. So it is
gone through in groups of segments, of which sums are kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.analysis.relinearise import AtFit, relinearise
from casid.errors import EstimationError, InputError, check_known
from casid.estimation.fit import Fit
from casid.estimation.residual_colour import (
    BLOCKS,
    ORDER,
    Colour,
    autoregression,
    coloured_score,
    estimated,
    gathered,
    noise_autocovariance,
)
from casid.estimation.solvers.objective import Objective
from casid.estimation.transcriptions.steps import output_function, sample_derivatives, step_function
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.estimation.uncertainty import prior_information, score_pieces
from casid.frames import brief
from casid.model.built import cached
from casid.model.splines import cubic_inputs
from casid.model.system import Model
from casid.native.compiler import Compilable
from casid.records.noise import pooled_sigma

_DEFAULT_METHOD = MultipleShooting()
_ENDLESS = 1e100
_LAGS = (ORDER + 1) * max(BLOCKS)
_GROUP_SAMPLES = 1024  # of which the derivatives are held at once; at least one segment


@dataclass(frozen=True, eq=False, kw_only=True)
class InputErrors:
    """Standard errors with noisy inputs."""

    covariance: np.ndarray  # (parameters, parameters) in the order of the fit's parameters
    std: Mapping[str, float]  # parameter -> 1-sigma
    share: Mapping[str, float]  # parameter -> part of its variance that comes from the inputs, 0 to 1

    __repr__ = brief


def input_noise_errors(fit: Fit, sigma: Mapping[str, float], method: MultipleShooting = _DEFAULT_METHOD) -> InputErrors:
    """Covariance of the estimates when inputs are measured with white noise of 1-sigma `sigma` (input -> value, SI).

    Measurement noise that was given is white. Estimated noise is the residuals' autocovariance less what the inputs
    cause, never below the noise of the band above the motion. `method` as in `relinearise`. Raises InputError for a
    name that is no input or a negative sigma, EstimationError for any cost but OutputError.
    """
    problem = fit.problem
    if not problem.is_output_error or not problem.simulated:
        raise EstimationError(
            f"input_noise_errors: the fit minimised {type(problem.cost).__name__}; only OutputError is propagated"
        )
    for name in cubic_inputs(problem.model, problem.records)[:1]:
        raise InputError(f"input_noise_errors: input '{name}' is cubic between samples; write hold='linear'")
    for name, value in sigma.items():
        check_known("input", (name,), problem.model.inputs, "input_noise_errors")
        if not (value >= 0.0 and np.isfinite(value)):
            raise InputError(f"input_noise_errors: sigma of '{name}' is {value}; expected a 1-sigma, zero or more")
    at = relinearise(fit, replace(method, substeps=1))  # noise of the inputs is that of their samples
    driven, caused = _driven(at, np.array([sigma.get(name, 0.0) for name in problem.model.inputs]))
    measured = _measured_score(at, caused)
    inverse = at.inverse
    covariance = inverse @ (measured + driven) @ inverse
    variance, from_inputs = np.diagonal(covariance), np.diagonal(inverse @ driven @ inverse)
    names = problem.parameters
    share = np.divide(from_inputs, variance, out=np.zeros(len(names)), where=variance > 0)
    return InputErrors(
        covariance=covariance,
        std=dict(zip(names, np.sqrt(np.maximum(variance, 0.0)).tolist(), strict=True)),
        share=dict(zip(names, share.tolist(), strict=True)),
    )


def with_noisy_inputs(model: Model, *inputs: str) -> Model:
    """The model with a disturbance "noise_<input>" on each named input, whose noise `FilterError` then estimates.
    Raises InputError for a name that is no input."""
    check_known("input", inputs, model.inputs, "with_noisy_inputs")
    added = ca.SX.sym("noise", len(inputs))
    received = ca.SX(model.u)
    for i, name in enumerate(inputs):
        received[model.inputs.index(name)] += added[i]
    return replace(
        model,
        disturbances=(*model.disturbances, *(f"noise_{name}" for name in inputs)),
        w=ca.vertcat(model.w, added),
        f=ca.substitute(model.f, model.u, received),
        h=ca.substitute(model.h, model.u, received),
    )


def _noise_given(at: AtFit) -> bool:
    return isinstance(at.objective.problem.noise, Mapping | np.ndarray)


def _measured_score(at: AtFit, caused: np.ndarray) -> np.ndarray:
    """(parameters, parameters) covariance of the gradient from the measurement noise, and the priors' information, for
    outputs' covariances `caused` (lags, outputs, outputs) by the inputs."""
    objective = at.objective
    sums = gathered(score_pieces(objective, at.value, at.linear))
    prior = prior_information(at.linear.hessian, sums)
    if _noise_given(at):
        colours = {c: Colour(a=np.ones(1), variance=1.0) for c in sums}  # of whitened residuals
    else:
        # of whole samples; what is missing from others changes their whitening, but little of what is caused
        whiten = at.value.noise.levels.whitening(np.ones((1, len(objective.problem.model.outputs))))[0]
        caused = np.einsum("io,loj,ij->li", whiten, caused, whiten)
        least = np.einsum("io,o,io->i", whiten, _least_variance(at), whiten)
        noise = noise_autocovariance(sums, prior, at.free)
        colours = {
            c: _left(noise[c], _of_blocks(caused[:, c], own.block), least[c], own.count) for c, own in sums.items()
        }
    pieces = score_pieces(at.objective, at.value, at.linear)
    return prior + coloured_score(colours, sums, pieces, len(prior))


def _of_blocks(autocovariance: np.ndarray, size: int) -> np.ndarray:
    """(ORDER + 1,) of sums over blocks of `size` samples, over the root of the size."""
    apart = np.arange(1 - size, size)
    at = np.abs(size * np.arange(ORDER + 1)[:, None] + apart)
    return autocovariance[at] @ (1.0 - np.abs(apart) / size)


def _left(noise: np.ndarray, caused: np.ndarray, least: float, count: int) -> Colour:
    """Colour of the measurement noise of a channel: (lags,) autocovariance of its residuals less what is caused.

    White where AIC prefers that, and where the difference has less power at low frequency, where the sensitivities are,
    than white noise of its variance: what is caused, and partly absorbed by the fit, was then taken off twice.
    """
    left = noise - caused
    left[0] = max(left[0], min(least, noise[0]))
    white = Colour(a=np.ones(1), variance=float(left[0]))
    whole = autoregression(noise, count)
    if not 0.0 < whole.variance < np.inf:
        return white
    expected = autoregression(caused + np.r_[left[0], np.zeros(len(left) - 1)], count)
    ways = np.correlate(expected.a, expected.a, "full")[len(expected.a) - 1 :]
    error = float(2.0 * ways @ noise[: len(ways)] - ways[0] * noise[0])  # of prediction, by what is expected
    cost_white = count * (np.log(expected.variance) + error / expected.variance) + 2
    cost_whole = count * (np.log(whole.variance) + 1.0) + 2 * len(whole.a)
    coloured = estimated(left, count)
    lower = coloured.variance / coloured.a.sum() ** 2 < white.variance
    return white if lower or cost_white <= cost_whole else coloured


def _least_variance(at: AtFit) -> np.ndarray:
    """(outputs,) of the noise in the band above the motion; zero where it cannot be judged."""
    problem = at.objective.problem
    high = [pooled_sigma([r[name] for r in problem.records if name in r]) for name in problem.model.outputs]
    return np.nan_to_num(np.square(high))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Group:
    """Consecutive segments of a record and the derivatives (k, L, rows, columns) at each of their samples: of the state
    after the step in state, parameters, input at its start and at its end. Then of the outputs in state, parameters,
    input.
    """

    record: int
    segments: slice
    by_state: np.ndarray
    by_parameter: np.ndarray
    by_start: np.ndarray
    by_end: np.ndarray
    y_by_state: np.ndarray
    y_by_parameter: np.ndarray
    y_by_input: np.ndarray


def _driven(at: AtFit, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(parameters, parameters) covariance of the gradient from input noise of 1-sigma `spread` (inputs,); (lags,
    outputs, outputs) what it causes in the outputs, zero where nobody needs it."""
    driven, caused, last = np.zeros_like(at.linear.hessian), _Caused(at, spread), np.zeros(0)
    for group in _groups(at):
        if not _noise_given(at):
            caused.add(group)
        gains, last = _gains(at, group, last)
        columns = at.objective.problem.columns(group.record)
        scaled = (gains * spread[:, None]).reshape(-1, len(columns))
        driven[np.ix_(columns, columns)] += scaled.T @ scaled
    return driven, caused.mean


class _Caused:
    """Mean covariance of the outputs with those of so many samples before, over the samples present, from input noise
    of 1-sigma `spread` (inputs,) since a record's start."""

    def __init__(self, at: AtFit, spread: np.ndarray) -> None:
        self._layout, self._spread = at.objective.layout, spread
        self._n, self._outputs = len(at.objective.scale), self._layout.z.shape[2]
        self._total = np.zeros((_LAGS, self._outputs, self._outputs))
        self._restart()

    def _restart(self) -> None:
        """A new record follows."""
        self._covariance = np.zeros((self._n, self._n))
        self._cross = np.zeros((_LAGS - 1, self._n, self._outputs))

    @property
    def mean(self) -> np.ndarray:
        """(lags, outputs, outputs)."""
        return self._total / np.maximum(self._layout.present.sum(axis=(0, 1)), 1.0)[:, None]

    def add(self, group: _Group) -> None:
        """Groups come in the order of time, one record after the other."""
        if group.segments.start in self._layout.first:
            self._restart()
        gain = ((group.by_start + group.by_end) * self._spread).reshape(-1, self._n, len(self._spread))
        direct = (group.y_by_input * self._spread).reshape(-1, self._outputs, len(self._spread))
        steps, reads = (e.reshape(len(gain), -1, self._n) for e in (group.by_state, group.y_by_state))
        seen = self._layout.present[group.segments].reshape(len(gain), self._outputs, 1)
        for step, own_c, own_gain, own_direct, present in zip(steps, reads, gain, direct, seen, strict=True):
            from_states = self._covariance @ own_c.T
            self._total[0] += present * (own_c @ from_states + own_direct @ own_direct.T)
            self._total[1:] += present * (own_c @ self._cross)
            # of the state after the step with each of the outputs up to now, the newest first
            newest = step @ from_states + own_gain @ own_direct.T
            # an unstable aircraft drifts without end, which its estimator follows: only finite numbers are needed
            self._cross = _finite(np.concatenate([newest[None], step @ self._cross[:-1]]))
            self._covariance = _finite(step @ self._covariance @ step.T + own_gain @ own_gain.T)


def _finite(values: np.ndarray) -> np.ndarray:
    return np.clip(values, -_ENDLESS, _ENDLESS)


def _gains(at: AtFit, group: _Group, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, inputs, f) derivatives of the gradient in the samples of a group's inputs, and (inputs, f) what the step of
    its last sample adds to those of the next group's first. `last` is the latter of the group before."""
    layout, record = at.objective.layout, at.objective.problem.records[group.record]
    begin = (group.segments.start - layout.segments_of(group.record).start) * layout.length
    size = min(len(record) - begin, (group.segments.stop - group.segments.start) * layout.length)
    here, following = (e.reshape(-1, *e.shape[2:])[:size] for e in _adjoint(at, group))
    if record.hold != "linear":
        return here + following, np.zeros_like(following[-1])
    here[1:] += following[:-1]
    if begin > 0:
        here[0] += last
    return here, following[-1].copy()  # zero at the end of a record: its last step takes no time


def _adjoint(at: AtFit, group: _Group) -> tuple[np.ndarray, np.ndarray]:
    """(k, L, inputs, f) derivatives of the gradient in the input at the start of a step and at its end."""
    layout, reduced = at.objective.layout, at.linear.reduced[group.record]
    first = layout.segments_of(group.record).start
    within = slice(group.segments.start - first, group.segments.stop - first)
    count, length, n, f = group.by_parameter.shape
    whiten = at.whitening[layout.pattern[group.segments]]
    sensitivity, adjoint = np.empty((count, length, n, f)), np.empty((count, length, n, f))
    s = -reduced.ds_p[within]
    for i in range(length):
        sensitivity[:, i] = s
        s = group.by_state[:, i] @ s + group.by_parameter[:, i]
    rows = whiten @ (group.y_by_state @ sensitivity + group.y_by_parameter)
    s = np.zeros((count, n, f))
    following = reduced.l_p[within]  # none after the last segment of the record
    s[: len(following)] = following
    for i in reversed(range(length)):
        adjoint[:, i] = s
        read = whiten[:, i] @ group.y_by_state[:, i]
        s = group.by_state[:, i].transpose(0, 2, 1) @ s + read.transpose(0, 2, 1) @ rows[:, i]
    here = (whiten @ group.y_by_input).transpose(0, 1, 3, 2) @ rows + group.by_start.transpose(0, 1, 3, 2) @ adjoint
    return here, group.by_end.transpose(0, 1, 3, 2) @ adjoint


def _groups(at: AtFit) -> Iterator[_Group]:
    """All segments in the order of time, one record after the other."""
    objective, problem, trajectory = at.objective, at.objective.problem, at.value.trajectory
    if trajectory is None:
        raise EstimationError("input noise: this fit has no trajectory")
    layout, model = objective.layout, problem.model
    kernel = cached(
        model, ("input slopes", tuple(problem.free_index), problem.feedback), lambda: _derivatives(at.objective)
    )
    most = min(max(_GROUP_SAMPLES // layout.length, 1), layout.segments)
    batch = kernel.mapped(most * layout.length)  # the size of a batch is fixed
    parameters, n, o = objective.parameters(at.point.theta), len(model.states), len(model.outputs)
    for record in range(len(problem.records)):
        own = layout.segments_of(record)
        for first in range(own.start, own.stop, most):
            segments = slice(first, min(first + most, own.stop))
            which = np.minimum(np.arange(first, first + most), segments.stop - 1)
            given = trajectory.states[which], layout.u0[which], layout.u1[which], layout.dt[which]
            raw = batch(*given, np.repeat(parameters[which], layout.length, axis=0))
            count = segments.stop - first
            derivatives = (
                r.reshape(most, layout.length, rows, r.shape[1])[:count].copy()
                for r, rows in zip(raw, (n, n, n, n, o, o, o), strict=True)
            )
            by_state, by_parameter, by_start, by_end, y_by_state, y_by_parameter, y_by_input = derivatives
            yield _Group(
                record=record,
                segments=segments,
                by_state=by_state,
                by_parameter=by_parameter,
                by_start=by_start,
                by_end=by_end,
                y_by_state=y_by_state,
                y_by_parameter=y_by_parameter,
                y_by_input=y_by_input,
            )


def _derivatives(objective: Objective) -> Compilable:
    """(x, u0, u1, dt, p) -> the derivatives of a _Group in its order, transposed."""
    problem = objective.problem
    model = problem.model
    plain = sample_derivatives(model, problem.free_index, (), problem.feedback)
    step, outputs = step_function(model, problem.feedback), output_function(model)
    x, u0, u1, dt, p = plain.sx_in()
    a, b, _, c, d = plain(x, u0, u1, dt, p)
    after, y = step(x, u0, u1, dt, p), outputs(x, u0, p)
    more = [ca.densify(ca.jacobian(e, u).T) for e, u in ((after, u0), (after, u1), (y, u0))]
    return Compilable(ca.Function("slopes", [x, u0, u1, dt, p], ca.cse([a, b, more[0], more[1], c, d, more[2]])))
