"""Multiple shooting as CasADi's users write it: a map of accumulated steps, IPOPT with a Gauss-Newton Hessian."""

from __future__ import annotations

import casadi as ca
import numpy as np

from problems.peers.common import Task

INTERVAL = 25


def casadi_ipopt_gn(task: Task) -> tuple[np.ndarray, float]:
    """(parameters, cost). The same intervals and steps as ours; building the programme is part of it."""
    n, steps = len(task.t), len(task.t) - 1
    size, count = len(task.x0), len(task.start)
    segments = steps // INTERVAL
    if segments * INTERVAL != steps:
        raise ValueError(f"{steps} steps are no multiple of {INTERVAL}")
    step = step_of(task)
    x = ca.SX.sym("x", size)
    output = ca.Function("output", [x], [ca.vertcat(*task.outputs(ca.vertsplit(x), ca))])
    simulate = step.mapaccum(INTERVAL).map(segments)

    scale = ca.DM(task.scale)
    P, S = ca.MX.sym("P", count), ca.MX.sym("S", size, segments)
    nodes = ca.repmat(scale, 1, segments) * S
    both = np.hstack([task.U[:-1], task.U[1:]]).T
    after = simulate(nodes, both, ca.repmat(P, 1, steps))
    states = ca.horzcat(nodes[:, 0], after)
    residual = (output.map(n)(states) - task.Z.T) / ca.repmat(ca.DM(task.sigma), 1, n)
    r = ca.vertcat(ca.vec(residual), (nodes[:, 0] - task.x0) / task.x0_std)
    defects = (after[:, INTERVAL - 1 :: INTERVAL][:, :-1] - nodes[:, 1:]) / ca.repmat(scale, 1, segments - 1)
    z = ca.vertcat(P, ca.vec(S))
    jacobian = ca.jacobian(r, z)
    weight, multipliers, parameters = ca.MX.sym("w"), ca.MX.sym("m", defects.numel()), ca.MX.sym("q", 0)
    hessian = ca.Function("hessian", [z, parameters, weight, multipliers], [weight * ca.triu(jacobian.T @ jacobian)])
    solver = ca.nlpsol(
        "solver",
        "ipopt",
        {"x": z, "f": 0.5 * ca.sumsqr(r), "g": ca.vec(defects)},
        {"hess_lag": hessian, "print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8}},
    )
    start = ca.vertcat(task.start, ca.vec(ca.DM(task.X[:-1:INTERVAL].T) / ca.repmat(scale, 1, segments)))
    found = solver(x0=start, lbg=0, ubg=0)
    return np.asarray(found["x"]).ravel()[:count], float(found["f"])


def step_of(task: Task) -> ca.Function:
    """(x, u at both ends, p) -> x after one step of Runge and Kutta's from a sample to the next."""
    size, width, count = len(task.x0), task.U.shape[1], len(task.start)
    x, u, p = ca.SX.sym("x", size), ca.SX.sym("u", 2 * width), ca.SX.sym("p", count)
    h = float(task.t[1] - task.t[0])

    def f(x: ca.SX, u: ca.SX) -> ca.SX:
        return ca.vertcat(*task.rates(ca.vertsplit(x), ca.vertsplit(u) if width else [], ca.vertsplit(p), ca))

    first, last = u[:width], u[width:]
    middle = (first + last) / 2
    k1 = f(x, first)
    k2 = f(x + h / 2 * k1, middle)
    k3 = f(x + h / 2 * k2, middle)
    k4 = f(x + h * k3, last)
    return ca.Function("step", [x, u, p], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


def casadi_ipopt_cvodes(task: Task) -> tuple[np.ndarray, float]:
    """The same by single shooting with CVODES' motion and sensitivities, for a stiff motion without inputs."""
    size, count = len(task.x0), len(task.start)
    x, p = ca.SX.sym("x", size), ca.SX.sym("p", count)
    scale = ca.DM(task.scale)
    slope = ca.vertcat(*task.rates(ca.vertsplit(scale * x), [], ca.vertsplit(p), ca)) / scale
    # backwards CVODES does not end
    tolerances = {"abstol": 1e-12, "reltol": 1e-9, "max_num_steps": 100_000, "enable_reverse": False}
    motion = ca.integrator(
        "motion", "cvodes", {"x": x, "p": p, "ode": slope}, float(task.t[0]), task.t[1:].tolist(), tolerances
    )
    z = ca.MX.sym("z", size + count)
    after = motion(x0=z[:size], p=z[size:])["xf"]
    off = (scale * ca.horzcat(z[:size], after) - task.Z.T) / ca.DM(task.sigma)
    r = ca.vertcat(ca.vec(off), (scale * z[:size] - task.x0) / task.x0_std)
    slopes = ca.Function("slopes", [z], [ca.jacobian(r, z), r])
    weight, nothing, parameters = ca.MX.sym("w"), ca.MX.sym("m", 0), ca.MX.sym("q", 0)
    J, now = slopes(z)
    options = {
        "hess_lag": ca.Function("hessian", [z, parameters, weight, nothing], [weight * ca.triu(J.T @ J)]),
        "grad_f": ca.Function("gradient", [z, parameters], [0.5 * ca.sumsqr(now), J.T @ now]),
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8},
    }
    solver = ca.nlpsol("solver", "ipopt", {"x": z, "f": 0.5 * ca.sumsqr(r)}, options)
    found = solver(x0=np.concatenate([task.x0 / task.scale, task.start]))
    return np.asarray(found["x"]).ravel()[size:], float(found["f"])
