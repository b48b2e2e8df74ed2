"""Direct collocation with pyomo.dae: Radau points in every sample interval, IPOPT through an AMPL file."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np

from problems.peers.common import INPUTS, STATES, Task, outputs, rates

DEGREE = 2


def pyomo(task: Task) -> tuple[np.ndarray, float]:
    """(parameters (16,), cost). Raises ModuleNotFoundError without pyomo or the ipopt executable."""
    from pyomo.environ import SolverFactory, value  # pyright: ignore[reportMissingImports]

    if shutil.which("ipopt") is None:
        raise ModuleNotFoundError("no executable 'ipopt'")
    model = build(task)
    SolverFactory("ipopt").solve(model, options={"tol": 1e-8})
    return np.array([value(model.p[i]) for i in range(16)]), float(value(model.cost))


def build(task: Task) -> Any:
    """The discretised programme, started at the measured trajectory."""
    import pyomo.environ as pe  # pyright: ignore[reportMissingImports]
    from pyomo.dae import ContinuousSet, DerivativeVar  # pyright: ignore[reportMissingImports]

    knots = [round(float(t), 9) for t in task.t]
    m = pe.ConcreteModel()
    m.t = ContinuousSet(initialize=knots)
    m.p = pe.Var(range(16), initialize=dict(enumerate(map(float, task.start))))

    def guess(_: Any, i: int, t: float) -> float:
        return float(np.interp(t, task.t, task.X[:, i]))

    scale = (144.0, 5.0, 5.0, 0.2, 0.1, 0.1, 0.3, 0.1)
    m.x = pe.Var(range(len(STATES)), m.t, initialize=lambda m, i, t: guess(m, i, t) / scale[i])
    m.dx = DerivativeVar(m.x, wrt=m.t)

    def state(t: float) -> list[Any]:
        return [m.x[i, t] * scale[i] for i in range(len(STATES))]

    def slope(m: Any, i: int, t: float) -> Any:
        if t == m.t.first():
            return pe.Constraint.Skip
        u = [float(np.interp(t, task.t, task.U[:, j])) for j in range(len(INPUTS))]
        return m.dx[i, t] * scale[i] == rates(state(t), u, m.p, pe)[i]

    m.motion = pe.Constraint(range(len(STATES)), m.t, rule=slope)
    pe.TransformationFactory("dae.collocation").apply_to(m, nfe=len(knots) - 1, ncp=DEGREE, scheme="LAGRANGE-RADAU")
    terms = []
    for t, z in zip(knots, task.Z, strict=True):
        terms += [
            ((y - float(a)) / float(s)) ** 2 for y, a, s in zip(outputs(state(t), pe), z, task.sigma, strict=True)
        ]
    terms += [((x - float(c)) / float(s)) ** 2 for x, c, s in zip(state(knots[0]), task.x0, task.x0_std, strict=True)]
    m.cost = pe.Objective(expr=0.5 * sum(terms))
    return m
