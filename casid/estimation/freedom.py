"""Degrees of freedom: what estimating the unknowns has taken from the residuals by which noise is estimated."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from casid.model.system import Model

if TYPE_CHECKING:
    from casid.estimation.solvers.objective import Objective
    from casid.estimation.solvers.point import Levels


def freedom(objective: Objective, levels: Levels, parameters: float) -> float:
    """Factor N / (N - f) of the variance of noise that was estimated from N samples along with f unknowns; 1 where the
    noise was given, infinity where nothing is left of the samples.

    The unknowns are the `parameters` as far as the data and not a prior determine them. So are the initial states of
    all records that some output shows and of which the caller knew no more than the scale, and what the equations have
    eliminated. It is exact for one channel (Draper and Smith, Applied Regression Analysis, ch. 1); several channels
    share the unknowns evenly.
    """
    if levels.fixed:
        return 1.0
    unknown, samples = parameters + _initial_states(objective), levels.count
    unknown += objective.equations.eliminated if objective.equations is not None else 0
    return samples / (samples - unknown) if samples > unknown + 1e-9 else math.inf


def _initial_states(objective: Objective) -> int:
    if objective.dynamics is None:
        return 0
    model = objective.problem.model
    weak = objective.initial_precision * model.scale_vector() <= 1.0 + 1e-9
    return int((weak & ~objective.exact & shown_states(model)).sum())


def shown_states(model: Model) -> np.ndarray:
    """(states,) whether any output depends on the state, at once or by way of other states."""
    shown = np.array([ca.depends_on(model.h, model.x[i]) for i in range(len(model.states))], dtype=bool)
    moved_by = np.zeros((len(model.states),) * 2, dtype=bool)
    for motion in (model.f, *model.events.values()):
        moved_by |= np.array(ca.DM(ca.jacobian_sparsity(motion, model.x), 1.0).full(), dtype=bool)
    for _ in model.states:
        shown = shown | (shown @ moved_by)
    return shown
