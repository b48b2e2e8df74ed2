"""Errors in the inputs: what noise of the measured surfaces does to the estimates.

An output-error fit takes its inputs as exact. Noise n_j of an input at sample j moves the predicted outputs, and with
them the gradient of the cost by G_j' n_j, where G_j comes from one backward pass (adjoint) over the fit's linearised
system with the states re-estimated. The estimate moves by the inverse information times that, so that

    cov = I^-1 (sum_ij J_i' W R(i-j) W J_j + sum_j G_j' S G_j) I^-1

with the autocovariance R of the measurement noise and the input noise S. First order in the noise: the attenuation of
estimates by errors in variables, of second order, is not in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.errors import EstimationError, InputError, unknown
from casid.estimation.compiler import Compilable
from casid.estimation.cost import OutputError
from casid.estimation.fit import Fit
from casid.estimation.noise import pooled_sigma
from casid.estimation.relinearise import AtFit, relinearise
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
from casid.estimation.steps import cached, output_function, sample_derivatives, step_function
from casid.estimation.transcription import MultipleShooting
from casid.estimation.uncertainty import prior_information, score_pieces
from casid.model.system import Model

_DEFAULT_METHOD = MultipleShooting()
_ENDLESS = 1e100
_LAGS = (ORDER + 1) * max(BLOCKS)


@dataclass(frozen=True, eq=False, kw_only=True)
class InputErrors:
    """Standard errors with noisy inputs.

    covariance  (parameters, parameters) in the order of the fit's parameters
    std         parameter -> 1-sigma
    share       parameter -> part of its variance that comes from the inputs, 0 to 1
    """

    covariance: np.ndarray
    std: Mapping[str, float]
    share: Mapping[str, float]


def input_noise_errors(fit: Fit, sigma: Mapping[str, float], method: MultipleShooting = _DEFAULT_METHOD) -> InputErrors:
    """Covariance of the estimates when inputs are measured with white noise of 1-sigma `sigma` (input -> value, SI).

    Measurement noise that was given is white. Where the fit estimated it, its residuals hold the effect of the inputs
    as well: then their autocovariance less what the inputs are expected to cause is that of the measurement noise (see
    residual_colour), and its variance never less than the noise of the band above the motion. `method` as in
    `relinearise`. Raises InputError for a name that is no input or a negative sigma, EstimationError for a cost other
    than OutputError.
    """
    problem = fit.problem
    if not isinstance(problem.cost, OutputError):
        raise EstimationError(
            f"input_noise_errors: the fit minimised {type(problem.cost).__name__}; only OutputError is propagated"
        )
    for name, value in sigma.items():
        if name not in problem.model.inputs:
            raise unknown("input", name, problem.model.inputs, "input_noise_errors")
        if not (value >= 0.0 and np.isfinite(value)):
            raise InputError(f"input_noise_errors: sigma of '{name}' is {value}; expected a 1-sigma, zero or more")
    at = relinearise(fit, method)
    spread = np.array([sigma.get(name, 0.0) for name in problem.model.inputs])
    slopes = _slopes(at)
    measured, driven = _measured_score(at, slopes, spread), np.zeros_like(at.linear.hessian)
    for r, gains in enumerate(_gains(at, slopes)):
        grid = np.ix_(problem.columns(r), problem.columns(r))
        scaled = gains * spread[:, None]
        driven[grid] += np.einsum("nmf,nmg->fg", scaled, scaled)
    inverse = at.inverse
    covariance = inverse @ (measured + driven) @ inverse
    variance, from_inputs = np.diagonal(covariance), np.diagonal(inverse @ driven @ inverse)
    names = problem.parameters
    share = np.divide(from_inputs, variance, out=np.zeros(len(names)), where=variance > 0)
    return InputErrors(
        covariance=covariance, std=dict(zip(names, np.sqrt(np.maximum(variance, 0.0)).tolist(), strict=True)),
        share=dict(zip(names, share.tolist(), strict=True)),
    )  # fmt: skip


def with_noisy_inputs(model: Model, *inputs: str) -> Model:
    """The model with a disturbance "noise_<input>" added to each named input.

    `filter_error(problem, {"noise_delta_e": 0.0})` then estimates the noise of the surface together with the
    parameters. Raises InputError for a name that is no input.
    """
    for name in inputs:
        if name not in model.inputs:
            raise unknown("input", name, model.inputs, "with_noisy_inputs")
    added = ca.SX.sym("noise", len(inputs))
    received = ca.SX(model.u)
    for i, name in enumerate(inputs):
        received[model.inputs.index(name)] += added[i]
    return replace(
        model, disturbances=(*model.disturbances, *(f"noise_{name}" for name in inputs)),
        w=ca.vertcat(model.w, added), f=ca.substitute(model.f, model.u, received),
        h=ca.substitute(model.h, model.u, received),
    )  # fmt: skip


def _measured_score(at: AtFit, slopes: list[np.ndarray], spread: np.ndarray) -> np.ndarray:
    """(parameters, parameters) covariance of the gradient from the measurement noise, and the priors' information."""
    objective = at.objective
    sums = gathered(score_pieces(objective, at.value, at.linear))
    prior = prior_information(at.linear, sums)
    if isinstance(objective.problem.noise, Mapping | np.ndarray):
        colours = {c: Colour(a=np.ones(1), variance=1.0) for c in sums}  # of whitened residuals
    else:
        # of whole samples; what is missing from others changes their whitening, but little of what is caused
        whiten = objective.levels.whitening(np.ones((1, len(objective.problem.model.outputs))))[0]
        caused = np.einsum("io,loj,ij->li", whiten, _caused(at, slopes, spread), whiten)
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

    White where that explains the residuals better than an autoregression does, by AIC, and where the difference has
    less power at low frequency, where the sensitivities are, than white noise of its variance: what is caused, and
    partly absorbed by the fit, was then taken off twice.
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


def _caused(at: AtFit, slopes: list[np.ndarray], spread: np.ndarray) -> np.ndarray:
    """(lags, outputs, outputs) mean covariance of the outputs with those of so many samples before, over the samples
    present, from input noise since a record's start."""
    a, _, e0, e1, c, _, df = slopes
    layout, n = at.objective.layout, a.shape[2]
    gain, direct = (e0 + e1) * spread, df * spread
    outputs = c.shape[2]
    total, covariance, cross = np.zeros((_LAGS, outputs, outputs)), np.zeros((n, n)), np.zeros((_LAGS - 1, n, outputs))
    for k in range(layout.segments):
        if k in layout.first:
            covariance, cross = np.zeros((n, n)), np.zeros((_LAGS - 1, n, outputs))
        for i in range(layout.length):
            seen, own_c, step = layout.present[k, i][:, None], c[k, i], a[k, i]
            from_states = covariance @ own_c.T
            total[0] += seen * (own_c @ from_states + direct[k, i] @ direct[k, i].T)
            total[1:] += seen * (own_c @ cross)
            # of the state after the step with each of the outputs up to now, the newest first
            newest = step @ from_states + gain[k, i] @ direct[k, i].T
            # an unstable aircraft drifts without end, which its estimator follows: only finite numbers are needed
            cross = np.clip(np.concatenate([newest[None], step @ cross[:-1]]), -_ENDLESS, _ENDLESS)
            covariance = np.clip(step @ covariance @ step.T + gain[k, i] @ gain[k, i].T, -_ENDLESS, _ENDLESS)
    return total / np.maximum(layout.present.sum(axis=(0, 1)), 1.0)[:, None]


def _gains(at: AtFit, slopes: list[np.ndarray]) -> list[np.ndarray]:
    """Per record: derivatives (N, inputs, f) of the gradient with respect to every sample of the inputs."""
    objective, problem = at.objective, at.objective.problem
    layout = objective.layout
    a, b, e0, e1, c, d, df = slopes
    count, length = layout.segments, layout.length
    n, f = a.shape[2], b.shape[3]
    whiten = objective.whitening[layout.pattern]
    sensitivity = np.zeros((length + 1, count, n, f))
    adjoint = np.zeros((length + 1, count, n, f))
    for r, reduced in enumerate(at.linear.reduced):
        own = layout.segments_of(r)
        sensitivity[0, own] = -reduced.ds_p
        adjoint[length, own.start : own.stop - 1] = reduced.l_p
    for i in range(length):
        sensitivity[i + 1] = a[:, i] @ sensitivity[i] + b[:, i]
    rows = whiten @ (c @ sensitivity[:-1].transpose(1, 0, 2, 3) + d)
    for i in reversed(range(length)):
        own_c = whiten[:, i] @ c[:, i]
        adjoint[i] = a[:, i].transpose(0, 2, 1) @ adjoint[i + 1] + own_c.transpose(0, 2, 1) @ rows[:, i]
    after = adjoint[1:].transpose(1, 0, 2, 3)
    here = (whiten @ df).transpose(0, 1, 3, 2) @ rows + e0.transpose(0, 1, 3, 2) @ after
    following = e1.transpose(0, 1, 3, 2) @ after
    found = []
    for r, record in enumerate(problem.records):
        flat = layout.sample[r]
        own = here.reshape(-1, *here.shape[2:])[flat]
        end = following.reshape(-1, *following.shape[2:])[flat]
        if record.hold == "linear":
            own[1:] += end[:-1]
            own[-1] += end[-1]
        else:
            own = own + end
        found.append(own)
    return found


def _slopes(at: AtFit) -> list[np.ndarray]:
    """(K, L, rows, columns) of dx+/dx, dx+/dp, dx+/du0, dx+/du1, dy/dx, dy/dp, dy/du."""
    objective, problem, trajectory = at.objective, at.objective.problem, at.value.trajectory
    if trajectory is None:
        raise EstimationError("input noise: this fit has no trajectory")
    model, free, layout = problem.model, problem.free_index, objective.layout

    def build() -> Compilable:
        plain = sample_derivatives(model, free, (), problem.feedback)
        step, outputs = step_function(model, problem.feedback), output_function(model)
        x, u0, u1, dt, p = plain.sx_in()
        a, b, _, c, d = plain(x, u0, u1, dt, p)
        after, y = step(x, u0, u1, dt, p), outputs(x, u0, p)
        more = [ca.densify(ca.jacobian(e, u).T) for e, u in ((after, u0), (after, u1), (y, u0))]
        return Compilable(ca.Function("slopes", [x, u0, u1, dt, p], ca.cse([a, b, more[0], more[1], c, d, more[2]])))

    kernel = cached(model, ("input slopes", tuple(free), problem.feedback), build)
    count, length, n, o = layout.segments, layout.length, len(model.states), len(model.outputs)
    repeated = np.repeat(objective.parameters(at.point.theta), length, axis=0)
    raw = kernel.mapped(count * length)(trajectory.states, layout.u0, layout.u1, layout.dt, repeated)
    height = (n, n, n, n, o, o, o)
    return [r.reshape(count, length, rows, r.shape[1]).copy() for r, rows in zip(raw, height, strict=True)]
