"""Multiple shooting as an optimal control problem of stages, by the structured solvers in CasADi's wheel: fatrop, and
HPIPM on the quadratic programmes of a Gauss-Newton SQP.

Both know stages only, so that the parameters are states that stay as they are.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from problems.peers.casadi import INTERVAL, step_of
from problems.peers.common import Task


def casadi_fatrop(task: Task) -> tuple[np.ndarray, float]:
    """(parameters, cost); building the programme is part of it."""
    programme, start, options, hessian = _programme(task)
    options |= {"structure_detection": "auto", "equality": [True] * programme["g"].numel()}
    options |= {"cache": {"nlp_hess_l": hessian}, "fatrop": {"print_level": 0, "tolerance": 1e-8}}
    return _solved(task, "fatrop", programme, start, options)


def casadi_sqp_hpipm(task: Task) -> tuple[np.ndarray, float]:
    """The same."""
    programme, start, options, hessian = _programme(task)
    options |= {"print_header": False, "print_iteration": False, "print_status": False}
    given = hessian.mx_in()
    alone = ca.Function("hessian", given, [hessian(*given)[1]])
    options |= {"hess_lag": alone, "hessian_approximation": "exact", "tol_pr": 1e-8, "tol_du": 1e-6}
    # next to the optimum HPIPM reports that it cannot meet its own tolerance, and the SQP that its steps become small
    options |= {"qpsol": "hpipm", "qpsol_options": {"print_time": False, "error_on_fail": False}}
    return _solved(task, "sqpmethod", programme, start, options)


def _solved(task: Task, name: str, programme: dict, start: Any, options: dict) -> tuple[np.ndarray, float]:
    found, n = ca.nlpsol("solver", name, programme, options)(x0=start, lbg=0, ubg=0), len(task.x0)
    return np.asarray(found["x"]).ravel()[n : n + len(task.start)], float(found["f"])


def _programme(task: Task) -> tuple[dict, np.ndarray, dict, ca.Function]:
    """(NLP, start, options, Gauss-Newton Hessian with the gradient of the Lagrangian): a stage begins at every 25th
    sample, the last sample is one of its own."""
    n, count, segments = len(task.x0), len(task.start), (len(task.t) - 1) // INTERVAL
    scale, sigma = ca.DM(task.scale), ca.DM(task.sigma)
    both = np.hstack([task.U[:-1], task.U[1:]]).T
    width, seen = both.shape[0], len(task.sigma)
    output = ca.Function("output", [x := ca.SX.sym("x", n)], [ca.vertcat(*task.outputs(ca.vertsplit(x), ca))])

    stage, u, z = ca.MX.sym("stage", n + count), ca.MX.sym("u", width, INTERVAL), ca.MX.sym("z", seen, INTERVAL)
    begin, p = scale * stage[:n], stage[n:]
    after = step_of(task).mapaccum(INTERVAL)(begin, u, ca.repmat(p, 1, INTERVAL))
    states = ca.horzcat(begin, after[:, : INTERVAL - 1])
    off = ca.vec((output.map(INTERVAL)(states) - z) / ca.repmat(sigma, 1, INTERVAL))
    segment = ca.Function("segment", [stage, u, z], [ca.vertcat(after[:, INTERVAL - 1] / scale, p), off])
    last, prior = (output(begin) - ca.DM(task.Z[-1])) / sigma, (begin - task.x0) / task.x0_std

    def squared(name: str, given: list[ca.MX], residual: ca.MX) -> ca.Function:
        slope = ca.jacobian(residual, stage)
        return ca.Function(name, given, [ca.densify(slope.T @ slope), ca.sumsqr(residual)])

    curvature = squared("curvature", [stage, u, z], off)
    at_end, at_start = squared("at_end", [stage], last), squared("at_start", [stage], prior)

    S = ca.MX.sym("S", n + count, segments + 1)
    measured = task.Z[:-1].T
    ends, residuals = segment.map(segments)(S[:, :-1], both, measured)
    cost = 0.5 * (ca.sumsqr(residuals) + at_end(S[:, segments])[1] + at_start(S[:, 0])[1])
    blocks = ca.horzsplit(curvature.map(segments)(S[:, :-1], both, measured)[0], n + count)
    blocks[0] += at_start(S[:, 0])[0]
    weight, multipliers, parameters = ca.MX.sym("w"), ca.MX.sym("m", ends.numel()), ca.MX.sym("q", 0)
    whole = weight * (ca.diagcat(*blocks, at_end(S[:, segments])[0]))
    z, gaps = ca.vec(S), ca.vec(S[:, 1:] - ends)
    slope = ca.gradient(weight * cost + ca.dot(multipliers, gaps), z)
    given, names = [z, parameters, weight, multipliers], ["x", "p", "lam_f", "lam_g"]
    # fatrop has no option for a Hessian of one's own: what it would make is there already under its name
    hessian = ca.Function("nlp_hess_l", given, [slope, whole], names, ["grad_gamma_x", "hess_gamma_x_x"])
    start = np.vstack([task.X[::INTERVAL].T / task.scale[:, None], np.tile(task.start[:, None], segments + 1)])
    return {"x": z, "f": cost, "g": gaps}, start.ravel(order="F"), {"print_time": False}, hessian
