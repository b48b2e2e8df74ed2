"""Truth: a published problem whose curvature the residuals bend, for which only exact derivatives come fast."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import casid as cs


@pytest.mark.parametrize(("last", "truth"), [(-1.0, 0.044744), (-4.0, -0.37193), (-8.0, -0.79148)])
def test_the_exact_hessian_is_newton_s_and_the_other_that_of_gauss_newton(last: float, truth: float) -> None:
    """exp(x h) through (1, 2), (2, 4), (3, `last`): Dennis and Schnabel, Numerical Methods for Unconstrained
    Optimization, example 10.2.4, with its solutions. Newton converges quadratically, Gauss-Newton linearly, for it
    leaves out what the residuals add to the curvature."""
    model = cs.define_regression(
        "exponential", inputs=["h"], parameters={"x": 1.0}, outputs=["y"], output=lambda s: {"y": ca.exp(s.x * s.h)}
    )
    channels = {"h": np.array([1.0, 2.0, 3.0]), "y": np.array([2.0, 4.0, last])}
    record = cs.Record(name="m", t=np.arange(3.0), channels=channels)
    problem = cs.Problem(model, [record], free=["x"], noise={"y": 1.0})
    exact, other = (cs.solve(problem, solver=cs.Ipopt(hessian=kind)) for kind in ("exact", "gauss-newton"))
    for fit in (exact, other):
        assert fit.converged and fit.values["x"] == pytest.approx(truth, rel=2e-5)
    assert 2 * exact.iterations < other.iterations
