"""Multiple shooting with rockit: a state at every sample, one step of Runge and Kutta between two, IPOPT with the exact
Hessian."""

from __future__ import annotations

import casadi as ca
import numpy as np

from problems.peers.common import Task, outputs, rates

SCALE = (144.0, 5.0, 5.0, 0.2, 0.1, 0.1, 0.3, 0.1)


def rockit(task: Task) -> tuple[np.ndarray, float]:
    """(parameters (16,), cost). Building the programme is part of it. Raises ModuleNotFoundError without rockit."""
    # pyright takes this file for the package
    from rockit import MultipleShooting, Ocp  # pyright: ignore[reportAttributeAccessIssue]

    steps, span = len(task.t) - 1, float(task.t[-1] - task.t[0])
    ocp = Ocp(t0=float(task.t[0]), T=span)
    x = [ocp.state(scale=s) for s in SCALE]
    p = ocp.variable(16)
    first, last = ocp.parameter(5, grid="control"), ocp.parameter(5, grid="control")
    begin = ocp.parameter(grid="control")
    measured = ocp.parameter(5, grid="control", include_last=True)
    u = first + (ocp.t - begin) * (steps / span) * (last - first)
    for state, slope in zip(x, rates(x, ca.vertsplit(u), ca.vertsplit(p), ca), strict=True):
        ocp.set_der(state, slope)
    off = (ca.vertcat(*outputs(x, ca)) - measured) / ca.DM(task.sigma)
    prior = (ocp.at_t0(ca.vertcat(*x)) - task.x0) / task.x0_std
    ocp.add_objective(0.5 * ocp.sum(ca.sumsqr(off), include_last=True))
    ocp.add_objective(0.5 * ca.sumsqr(prior))
    ocp.set_value(first, task.U[:-1].T)
    ocp.set_value(last, task.U[1:].T)
    ocp.set_value(begin, task.t[:-1])
    ocp.set_value(measured, task.Z.T)
    for state, guess in zip(x, task.X.T, strict=True):
        ocp.set_initial(state, guess)
    ocp.set_initial(p, task.start)
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8}}
    ocp.solver("ipopt", options)
    ocp.method(MultipleShooting(N=steps, M=1, intg="rk"))
    found = ocp.solve()
    return np.asarray(found.value(p)).ravel(), float(found.value(ocp.objective))
