"""Errors of the initial states, which every step eliminates before the parameters are seen.

With the parameters known, the initial states of a record have the covariance S, a block of the inverse of the banded
system; with the parameters they move by D. Their covariance is then S + D C D', with C of the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.point import Linearised


@dataclass(frozen=True, eq=False, kw_only=True)
class InitialErrors:
    """given (records, states, states): covariance S with the parameters known, zero where a state is exact; moved
    (records, states, parameters): D; precision (records, states): of the prior, 1/variance."""

    given: np.ndarray
    moved: np.ndarray
    precision: np.ndarray

    def variances(self, covariance: np.ndarray, inflation: float = 1.0) -> np.ndarray:
        """(records, states) with the covariance of the parameters, and data of so many times the variance."""
        prior = np.einsum("rij,rj,rji->ri", self.given, self.precision, self.given)
        own = np.diagonal(self.given, axis1=1, axis2=2)
        by_parameters = np.einsum("rip,pq,riq->ri", self.moved, covariance, self.moved)
        return np.maximum(own + (inflation - 1.0) * (own - prior) + by_parameters, 0.0)

    def told(self, covariance: np.ndarray) -> float:
        """Return how many initial states the data determine, each counted as far as they and not the prior do."""
        free = np.diagonal(self.given, axis1=1, axis2=2) > 0.0
        share = 1.0 - self.variances(covariance) * self.precision
        return float(np.clip(share, 0.0, 1.0)[free].sum())


def initial_errors(objective: AnyObjective, linear: Linearised) -> InitialErrors | None:
    """At a linearisation; None where nothing is simulated. Raises numpy.linalg.LinAlgError where a record's states are
    not determined."""
    blocks = linear.blocks
    if blocks is None or isinstance(objective, OwnObjective):
        return None
    n = len(objective.scale)
    records = len(objective.problem.records)
    given = np.zeros((records, n, n))
    moved = np.zeros((records, n, len(objective.problem.parameters)))
    for r in range(records):
        own = objective.layout.segments_of(r)
        inner = blocks.hessian.shape[1]
        hessian = np.pad(blocks.hessian[own], ((0, 0), (0, n), (0, n)))
        # a further unknown that pulls at each initial state: the states' answers are columns of the inverse
        hessian[0, :n, inner:] = hessian[0, inner:, :n] = np.eye(n)
        gradient = np.pad(blocks.gradient[own], ((0, 0), (0, n)))
        transition = np.pad(blocks.transition[own], ((0, 0), (0, 0), (0, n)))
        bordered = hessian, gradient, transition
        first = objective.reduced(r, bordered, blocks, linear.point).ds_p[0]
        free = ~objective.exact[r]
        given[r] = first[:, inner - n :] * free * free[:, None]
        moved[r][:, objective.problem.columns(r)] = -first[:, : inner - n] * free[:, None]
    return InitialErrors(given=given, moved=moved, precision=objective.initial_precision**2)
