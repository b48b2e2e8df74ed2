"""First and second derivatives of a nonlinear programme put together from those of its segments.

Cost and constraints see the unknowns directly, where CasADi differentiates them, and through end states and outputs of
the segments. Each segment depends on its start state and free parameters alone, so that its part of the Hessian is a
small dense block; which number of which block goes where is a constant sparse matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.transcriptions.dynamics import ShotDerivatives


@dataclass(frozen=True, eq=False, kw_only=True)
class Separable:
    """The programme with symbols `end`, `y` in place of what is simulated; residual and g are written in these."""

    derivatives: ShotDerivatives  # derivatives, arguments: of the segments, and what they are taken at
    arguments: list[ca.MX]
    simulated: tuple[ca.MX, ca.MX]  # end and outputs as expressions in the variables
    end: ca.MX
    y: ca.MX
    residual: ca.MX
    g: ca.MX
    curvature: ca.MX  # (o, K*L) of half the sum of squares, in the outputs
    scale: ca.MX  # of the variables: theta, nodes, others


def separable_functions(
    objective: Objective, at: Separable, x: ca.MX, p: ca.MX, gain: ca.MX, exact: bool
) -> dict[str, ca.Function]:
    """jac_g and hess_lag, as casadi.nlpsol takes them; exact, or with the Hessian of Gauss and Newton."""
    multipliers = ca.MX.sym("lam_g", at.g.numel())
    factor = ca.MX.sym("lam_f")
    return {
        "jac_g": _jacobian(objective, at, x, p),
        "hess_lag": _hessian(objective, at, [x, p, factor, multipliers], gain, exact),
    }


def _places(objective: Objective) -> np.ndarray:
    """(K, n+f) where start state and free parameters of each segment are among the variables."""
    problem = objective.problem
    layout = objective.layout
    n = len(objective.scale)
    nodes = len(problem.parameters) + np.arange(layout.segments * n).reshape(-1, n)
    own = np.array([problem.columns(r) for r in range(len(problem.records))], dtype=int)
    return np.hstack([nodes, own.reshape(len(problem.records), -1)[layout.record]])


def _jacobian(objective: Objective, at: Separable, x: ca.MX, p: ca.MX) -> ca.Function:
    places = _places(objective)
    n = len(objective.scale)
    count, nf = places.shape
    rows = np.broadcast_to(np.arange(count * n).reshape(count, 1, n), (count, nf, n)).ravel()
    columns = np.repeat(places.ravel(), n)
    order = np.lexsort((rows, columns))
    pattern = ca.Sparsity.triplet(count * n, x.numel(), rows[order].tolist(), columns[order].tolist())
    values = ca.vec(at.derivatives.first(*at.arguments))[order.tolist()] * at.scale[columns[order].tolist()]
    through = ca.MX(pattern, values)
    direct = ca.jacobian(at.g, x) + ca.jacobian(at.g, at.end) @ through
    return ca.Function("nlp_jac_g", [x, p], [*_simulated(at, [at.g, direct])], ["x", "p"], ["g", "jac_g_x"])


def _hessian(objective: Objective, at: Separable, given: list[ca.MX], gain: ca.MX, exact: bool) -> ca.Function:
    x, _, factor, multipliers = given
    if exact:
        lagrangian = 0.5 * factor * gain * ca.sumsqr(at.residual) + ca.dot(multipliers, at.g)
        direct = ca.hessian(lagrangian, x)[0]
        into_end = ca.gradient(lagrangian, at.end)
        into_y = ca.gradient(lagrangian, at.y)
    else:
        slope = ca.jacobian(at.residual, x)
        direct = factor * gain * (slope.T @ slope)
        into_end = ca.MX.zeros(*at.end.shape)
        into_y = ca.MX.zeros(*at.y.shape)
    curvature = factor * gain * at.curvature
    triangles = at.derivatives.second(*at.arguments, ca.densify(into_end), ca.densify(into_y), curvature)
    pattern, gathering = _gathering(_places(objective), x.numel())
    rows, columns = pattern.get_triplet()
    values = (gathering @ ca.vec(triangles)) * at.scale[rows] * at.scale[columns]
    total = _simulated(at, [ca.triu(direct) + ca.MX(pattern, values)])
    return ca.Function("nlp_hess_l", given, total, ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])


def _gathering(places: np.ndarray, size: int) -> tuple[ca.Sparsity, ca.DM]:
    """The upper triangle that the segments' triangles (column-major) fill, and the matrix that sums them there."""
    j, i = np.tril_indices(places.shape[1])  # the upper triangle, column after column
    ends = places[:, i].ravel(), places[:, j].ravel()
    first = np.minimum(*ends)
    second = np.maximum(*ends)
    keys, target = np.unique(second * size + first, return_inverse=True)
    pattern = ca.Sparsity.triplet(size, size, (keys % size).tolist(), (keys // size).tolist())
    into = ca.Sparsity.triplet(len(keys), len(target), target.ravel().tolist(), list(range(len(target))))
    return pattern, ca.DM(into, 1.0)


def _simulated(at: Separable, expressions: list[ca.MX]) -> list[ca.MX]:
    """The expressions with what is simulated in place of its symbols."""
    return ca.graph_substitute(expressions, [at.end, at.y], list(at.simulated))
