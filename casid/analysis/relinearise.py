"""The linearisation at a fit once more: what uncertainty and identifiability need beyond the solver's own results."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from casid.errors import EstimationError
from casid.estimation.attempt import build_objective
from casid.estimation.cost import OwnLikelihood
from casid.estimation.fit import Fit
from casid.estimation.problem import check_plain
from casid.estimation.solvers.identified import weak_pull
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point
from casid.estimation.solvers.quadratic import inverse_along
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.estimation.working import along_splines

_DEFAULT_METHOD = MultipleShooting()


@dataclass(frozen=True, eq=False, kw_only=True)
class AtFit:
    """A fit's objective, point, value and linearisation."""

    fit: Fit
    objective: Any  # as of `Attempt`
    point: Point
    value: ObjectiveValue
    linear: Linearised

    @property
    def information(self) -> np.ndarray:
        """(parameters, parameters) what the data say: initial states eliminated; priors of parameters left out, and
        those of initial states of which nothing is known."""
        pull = weak_pull(self.objective, self.linear)
        return self.linear.hessian - np.diag(1.0 / self.objective.problem.prior_std**2) - pull.T @ pull

    @property
    def whitening(self) -> np.ndarray:
        """(patterns, o, o) lower triangle that whitens the residuals of each pattern of present samples."""
        return self.objective.whitening(self.value.noise.levels)

    @cached_property
    def free(self) -> np.ndarray:
        """(parameters, directions) in which no active limit of the fit holds the parameters."""
        return self.objective.limits.free_directions(self.point.theta, self.fit.multipliers)

    @cached_property
    def inverse(self) -> np.ndarray:
        """(parameters, parameters) change of the estimate per change of the gradient, priors included; none along
        active limits. Raises numpy.linalg.LinAlgError when the parameters are not determined."""
        return inverse_along(self.free, self.linear.hessian)


def relinearise(fit: Fit, method: MultipleShooting = _DEFAULT_METHOD) -> AtFit:
    """Linearise at the estimates of `fit`; every transcription has the same information. Give `method` when the fit had
    process noise. Raises numpy.linalg.LinAlgError when a record's states are not determined, EstimationError for a
    problem that is solved in other coordinates."""
    check_plain(fit.problem, "identifiability and input noise")
    if isinstance(fit.problem.cost, OwnLikelihood):  # whose linearisation is at the estimates already
        solved = fit.uncertainty.solved
        if solved.linear is None:
            raise EstimationError("identifiability: the fit has no linearisation; solve it anew")
        linear = solved.linear
        return AtFit(fit=fit, objective=solved.objective, point=linear.point, value=solved.value, linear=linear)
    problem = along_splines(fit.problem)
    if method.substeps is None:
        method = replace(method, substeps=fit.substeps)
    objective = build_objective(problem, method)
    theta = np.array(list(fit.values.values()))
    nodes = noise = np.zeros((0, 0))
    if objective.dynamics is not None:
        states = [fit.states[record.name].trajectory[:: method.interval] for record in problem.records]
        nodes = np.concatenate(states)
        noise = np.zeros((len(objective.layout.tied), nodes.shape[1]))
    point = Point(theta=theta, nodes=nodes, noise=noise)
    value, _ = objective.relaxed(point, objective.value(point))
    linear = objective.linearise(point, value)
    value = objective.reweighed(point, value, linear.noise)
    return AtFit(fit=fit, objective=objective, point=point, value=value, linear=linear)
