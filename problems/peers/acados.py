"""Gauss-Newton SQP with acados: a state at every sample, HPIPM on the condensed problem, generated and compiled C code.

The parameters are states that stay as they are, for acados has no others that it can estimate.
"""

from __future__ import annotations

import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from problems.peers.common import Task, outputs, rates, task


def acados(data: Task) -> tuple[np.ndarray, float]:
    """(parameters (16,), cost). The solver is generated and compiled once per process, and is none of the later calls'
    time. Raises ModuleNotFoundError without acados' Python interface."""
    solver, steps = _solver(len(data.t)), len(data.t) - 1
    for k in range(steps + 1):
        reference = np.concatenate([data.Z[k], data.x0]) if k == 0 else data.Z[k]
        solver.cost_set(k, "yref", reference)
        solver.set(k, "x", np.concatenate([data.X[k], data.start]))
        solver.set(k, "p", np.concatenate([data.U[k], data.U[min(k + 1, steps)]]))
    status = solver.solve()
    if status != 0:
        raise ValueError(f"acados ends with the status {status}")
    return np.array(solver.get(0, "x"))[8:], float(solver.get_cost())


@cache
def _solver(samples: int) -> Any:
    """acados' solver for so many samples."""
    from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver  # pyright: ignore[reportMissingImports]

    data = task(samples)
    x, p, u = ca.SX.sym("x", 8), ca.SX.sym("p", 16), ca.SX.sym("u", 10)
    h = float(data.t[1] - data.t[0])
    model, ocp = AcadosModel(), AcadosOcp()
    model.name, model.x, model.u, model.p = "do328", ca.vertcat(x, p), ca.SX.sym("none", 0), u
    model.disc_dyn_expr = ca.vertcat(_step(x, u, p, h), p)
    seen = ca.vertcat(*outputs(ca.vertsplit(x), ca))
    model.cost_y_expr_0, model.cost_y_expr, model.cost_y_expr_e = ca.vertcat(seen, x), seen, seen
    ocp.model, ocp.dims.N, ocp.parameter_values = model, samples - 1, np.zeros(10)
    cost, weight = ocp.cost, np.diag(data.sigma**-2.0)
    cost.cost_type_0 = cost.cost_type = cost.cost_type_e = "NONLINEAR_LS"
    cost.W_0 = np.diag(np.concatenate([data.sigma, data.x0_std]) ** -2.0)
    cost.W, cost.W_e = weight, weight
    cost.yref_0, cost.yref, cost.yref_e = np.zeros(13), np.zeros(5), np.zeros(5)
    options = ocp.solver_options
    options.tf = float(samples - 1)  # steps of one, with which acados weighs the cost of a stage
    options.integrator_type, options.hessian_approx, options.nlp_solver_type = "DISCRETE", "GAUSS_NEWTON", "SQP"
    options.qp_solver, options.nlp_solver_max_iter = "FULL_CONDENSING_HPIPM", 100
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        return AcadosOcpSolver(ocp, json_file=str(Path(folder) / "do328.json"), verbose=False)


def _step(x: ca.SX, u: ca.SX, p: ca.SX, h: float) -> ca.SX:
    """After one step of Runge and Kutta with inputs from u[:5] to u[5:]."""

    def f(x: ca.SX, u: ca.SX) -> ca.SX:
        return ca.vertcat(*rates(ca.vertsplit(x), ca.vertsplit(u), ca.vertsplit(p), ca))

    first, last = u[:5], u[5:]
    middle = (first + last) / 2
    k1 = f(x, first)
    k2 = f(x + h / 2 * k1, middle)
    k3 = f(x + h / 2 * k2, middle)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3, last))
