"""Truth: parameters and standard deviations that NIST certifies for nonlinear regression."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import casid as cs
from problems.references.nist import FORMULAS, read_reference

# of the 27: the five on which undamped steps run off, one that creeps, one of many parameters, one of two predictors
QUICK = ("BoxBOD", "Eckerle4", "MGH09", "MGH10", "MGH17", "Bennett5", "ENSO", "Nelson")


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", QUICK)
def test_certified_digits(name, start, regression_data):
    reference = read_reference(regression_data / f"{name}.dat")
    fit = cs.solve(reference.problem(start))
    assert fit.converged, fit.status
    values, std = (np.array([getattr(fit[name], of) for name in fit.values]) for of in ("value", "std"))
    assert reference.digits(values) >= 6.0
    np.testing.assert_allclose(std[reference.in_order(values)], reference.std, rtol=1e-4)


# of the five that IPOPT did not reach: a plateau, one that needs more than 300 steps, one whose terms change places
@pytest.mark.parametrize("name", ["BoxBOD", "MGH10", "MGH17"])
def test_certified_digits_by_ipopt(name, regression_data):
    reference = read_reference(regression_data / f"{name}.dat")
    fit = cs.solve(reference.problem(0), solver=cs.Ipopt())
    assert fit.converged and reference.digits(np.array(list(fit.values.values()))) >= 6.0


def test_a_plateau_is_no_solution(regression_data):
    """With the Hessian of Gauss-Newton IPOPT ends where the exponentials have vanished, and names them."""
    solver = cs.Ipopt(hessian="gauss-newton")
    fit = cs.solve(read_reference(regression_data / "MGH17.dat").problem(0), solver=solver)
    assert not fit.converged and "b4" in fit.status and "b5" in fit.status


def test_every_formula_has_its_data(regression_data: Path):
    assert sorted(FORMULAS) == sorted(path.stem for path in regression_data.glob("*.dat"))


def test_a_saddle_is_no_solution():
    """At a = 0 the gradient of (a^2 - 1)^2 vanishes, and it is a maximum; a start beside it finds a minimum."""
    model = cs.define_regression(
        "quartic", inputs=("x",), parameters={"a": 0.0}, outputs=("y",), output=lambda s: {"y": s.a**2 * s.x}
    )
    x = np.linspace(1.0, 2.0, 20)
    record = cs.Record(name="m1", t=np.arange(20.0), channels={"x": x, "y": x})
    assert not cs.solve(cs.Problem(model, [record], free=["a"], noise={"y": 0.1})).converged
    fit = cs.solve(cs.Problem(model, [record], free=["a"], noise={"y": 0.1}, start={"a": 0.01}))
    assert fit.converged and fit["a"].value == pytest.approx(1.0, abs=1e-6)
