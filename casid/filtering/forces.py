"""Noise of forces and moments: the filter error of an aircraft whose coefficients are noisy."""

from __future__ import annotations

import numpy as np

from casid.estimation.problem import Problem
from casid.filtering.cost import FilterError
from casid.filtering.innovations import PointFunctions, make_batch


def noise_of_forces(problem: Problem) -> FilterError:
    """Filter error with white noise on every coefficient of an aircraft model that moves a state, on all disturbances
    of another model."""
    model = problem.model
    coefficients = [d for d in model.disturbances if d in _INCREMENTS]
    return FilterError(process_noise=dict.fromkeys(_moving(problem, coefficients or list(model.disturbances)), 0.0))


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
