"""Noise for soft defects: forces and moments that are noisy, with the variances of highest likelihood."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from casid.estimation.problem import Problem
from casid.filtering.filter_error import FilterFit, filter_error
from casid.filtering.innovations import PointFunctions, linearise, make_batch, padded


def noise_of_forces(problem: Problem) -> FilterFit:
    """Filter error with white noise on every coefficient of an aircraft model that moves a state, on all disturbances
    of another model. Raises EstimationError as `filter_error`."""
    model = problem.model
    coefficients = [d for d in model.disturbances if d in _INCREMENTS]
    return filter_error(problem, dict.fromkeys(_moving(problem, coefficients or list(model.disturbances)), 0.0))


_INCREMENTS = ("dCL", "dCD", "dCX", "dCZ", "dCY", "dCl", "dCm", "dCn")


def _moving(problem: Problem, names: list[str]) -> list[str]:
    """The disturbances that drive some state."""
    record = problem.records[0]
    P = problem.start_parameters
    batch = make_batch(problem.model, [record])
    X = problem.model.guess(record)[:, None]
    calm = np.zeros((*batch.live.shape, len(problem.model.disturbances)))
    by_w = PointFunctions(problem.model, ()).jacobians(X, batch.U, P[:1], calm)[2]
    states = np.abs(by_w[:, 0, : len(problem.model.states)]).max(axis=(0, 1))
    return [name for name in names if states[problem.model.disturbances.index(name)] > 0.0]


def with_measurement_noise(problem: Problem, found: FilterFit) -> Problem:
    """The problem from the estimates of a filter-error fit on, with its measurement noise given, to which process noise
    that an output feels at once (an accelerometer a noisy force) adds."""
    model = problem.model
    theta = np.array([found.values[name] for name in problem.parameters])
    batch = make_batch(model, problem.records)
    X = padded([found.innovations.states[record.name] for record in problem.records])
    linear = linearise(PointFunctions(model, ()), batch, problem.model_parameters(theta), X)
    felt = np.zeros(len(model.outputs))
    for name, sigma in found.noise.white.items():
        felt += sigma**2 * np.mean(linear.Dw[..., model.disturbances.index(name)][batch.live] ** 2, axis=0)
    noise = {
        output: math.sqrt(found.noise.measurement[output] ** 2 + felt[i]) for i, output in enumerate(model.outputs)
    }
    return replace(problem, noise=noise, start=dict(found.values))
