"""Instructions on arrays: the truth is CasADi's own virtual machine, point by point."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casid.native.emitter import UnknownOperationError
from casid.native.tape import BATCHED, Tape

x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
a, b = x[0], x[1]
EXPRESSIONS = {
    "arithmetic": (a + b, a - b, a * b, a / b, -a, a**2, 2 * a, 1 / a, a**3, ca.fabs(a) ** b),
    "trigonometry": (ca.sin(a), ca.cos(a), ca.tan(a), ca.asin(a), ca.acos(a), ca.atan(a), ca.atan2(a, b)),
    "hyperbolic": (ca.sinh(a), ca.cosh(a), ca.tanh(a), ca.asinh(a), ca.acosh(2 + a), ca.atanh(a)),
    "exponential": (ca.exp(a), ca.log(b), ca.log1p(a), ca.expm1(a), ca.sqrt(b), ca.erf(a)),
    "steps": (ca.fabs(a), ca.floor(3 * a), ca.ceil(3 * a), ca.sign(a), ca.fmod(3 * a, b), ca.copysign(a, y)),
    "choice": (ca.fmin(a, b), ca.fmax(a, b), ca.if_else(a < b, a, 2 * b), ca.if_else(a <= 0, y, ca.hypot(a, b))),
    "logic": (ca.if_else(ca.logic_and(a > 0, y > 0), a, b), ca.logic_or(a > 0, y > 0), ca.logic_not(a > 0), a != b),
    "order": (a < b, a <= 0.1, a == y, ca.if_else(a == b, 1.0, 2.0)),
}


def points() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.uniform(-0.9, 0.9, (40, 2)) + [0.0, 1.0], rng.normal(size=(40, 1))


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_operation_is_that_of_casadi(name: str) -> None:
    function = ca.Function("f", [x, y], [ca.vertcat(*EXPRESSIONS[name]), ca.DM([[1.0, 2.0]]) * y])
    given = points()
    found = Tape(function).mapped(*given)
    for mine, theirs in zip(found, function.map(40)(*(v.T for v in given)), strict=True):
        np.testing.assert_allclose(mine, np.asarray(theirs.full()).T, rtol=1e-14, atol=1e-15)


def test_a_sequence_is_that_of_casadi() -> None:
    """Three sequences of seven steps, with an argument that has no rows."""
    z = ca.SX.sym("z", 0)
    function = ca.Function("step", [x, z, y], [ca.vertcat(ca.sin(b) + y, a * b)])
    rng = np.random.default_rng(4)
    start, along = rng.normal(size=(3, 2)), rng.normal(size=(3, 7, 1))
    (found,) = Tape(function).accumulated(start, np.empty((3, 7, 0)), along)
    for k in range(3):
        truth = function.mapaccum(7)(start[k], ca.DM(0, 7), along[k].T).full()
        np.testing.assert_allclose(found[k], truth.T, rtol=1e-14, atol=1e-15)


def test_what_it_does_not_know_it_says() -> None:
    table = ca.interpolant("table", "bspline", [[0.0, 1.0, 2.0, 3.0]], [0.0, 1.0, 4.0, 9.0])
    with pytest.raises(UnknownOperationError):
        Tape(ca.Function("f", [y], [table(y)]))


@pytest.mark.parametrize("left_out", range(3))
def test_a_result_of_a_call_that_nothing_looks_at_has_no_place(left_out: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A call with three results, of which one is looked at by nobody. Truth: the same call of CasADi."""
    inner = ca.Function("inner", [x, y], [a + 2.0 * b, y - b, ca.sin(y) * a], {"never_inline": True})

    def at(points: np.ndarray) -> np.ndarray:
        u, v, w = points.T
        return np.stack([u + 2.0 * v, w - v, np.sin(w) * u], axis=1)

    monkeypatch.setitem(BATCHED, "inner", at)
    function = ca.Function("outer", [x, y], [2.0 * one for i, one in enumerate(inner(x, y)) if i != left_out])
    given = points()
    found = Tape(function).mapped(*given)
    for mine, theirs in zip(found, function.map(40)(*(one.T for one in given)), strict=True):
        np.testing.assert_allclose(mine, np.asarray(theirs.full()).T, rtol=1e-14, atol=1e-15)
