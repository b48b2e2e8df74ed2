"""Gridded look-up against scipy's interpolators, on grids and at points drawn at random."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator, make_interp_spline

from casid.errors import InputError
from casid.model.tables import Grid


def drawn(rng: np.random.Generator, shape: tuple[int, ...], method: str = "linear", outside: str = "hold") -> Grid:
    axes = tuple(tuple(np.sort(rng.uniform(-1.0, 1.0, n)).tolist()) for n in shape)
    return Grid(breakpoints=axes, values=tuple(rng.normal(size=np.prod(shape))), method=method, outside=outside)


def function(grid: Grid) -> ca.Function:
    x = ca.SX.sym("x", len(grid.shape))
    return ca.Function("look_up", [x], [grid.at(*ca.vertsplit(x))])


@pytest.mark.parametrize("shape", [(2,), (7,), (5, 4), (1, 3), (4, 3, 5)])
def test_linear_is_multilinear_and_held_outside(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    grid = drawn(rng, shape)
    points = rng.uniform(-1.3, 1.3, (300, len(shape)))
    held = np.stack([np.clip(x, axis[0], axis[-1]) for x, axis in zip(points.T, grid.breakpoints, strict=True)], axis=1)
    several = [i for i, n in enumerate(shape) if n > 1]  # scipy has no axis of a single point
    values = np.reshape(grid.values, shape).squeeze()
    truth = RegularGridInterpolator([grid.breakpoints[i] for i in several], values)(held[:, several])
    np.testing.assert_allclose(function(grid)(points.T).full()[0], truth, atol=1e-13)


def test_linear_may_go_on_outside() -> None:
    rng = np.random.default_rng(4)
    grid = drawn(rng, (4, 3), outside="linear")
    points = rng.uniform(-2.0, 2.0, (200, 2))
    interpolate = RegularGridInterpolator(
        grid.breakpoints, np.reshape(grid.values, grid.shape), bounds_error=False, fill_value=None
    )
    np.testing.assert_allclose(function(grid)(points.T).full()[0], interpolate(points), atol=1e-12)


@pytest.mark.parametrize("shape", [(7,), (6, 5), (4, 6, 5)])
def test_spline_is_the_cubic_interpolant_in_each_direction(shape: tuple[int, ...]) -> None:
    """Also with symbols for its values, as free knots have them."""
    rng = np.random.default_rng(5)
    grid = drawn(rng, shape, method="spline")
    x, knots = ca.SX.sym("x", len(shape)), ca.SX.sym("knots", int(np.prod(shape)))
    free = ca.Function("free", [x, knots], [grid.at(*ca.vertsplit(x), values=ca.vertsplit(knots))])
    for point in rng.uniform(-1.3, 1.3, (60, len(shape))):
        truth = np.reshape(grid.values, shape)
        for axis, y in zip(grid.breakpoints, point, strict=True):
            truth = make_interp_spline(axis, truth)(np.clip(y, axis[0], axis[-1]))
        assert float(function(grid)(point)) == pytest.approx(float(truth), abs=1e-10)
        assert float(free(point, grid.values)) == pytest.approx(float(truth), abs=1e-10)


def test_spline_has_the_second_derivative_of_the_interpolant() -> None:
    rng = np.random.default_rng(6)
    grid = drawn(rng, (7,), method="spline")
    (axis,) = grid.breakpoints
    x = ca.SX.sym("x")
    second = ca.Function("second", [x], [ca.hessian(grid.at(x), x)[0]])
    points = rng.uniform(axis[0], axis[-1], 50)
    truth = make_interp_spline(axis, grid.values).derivative(2)(points)
    np.testing.assert_allclose(second(points[None]).full()[0], truth, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("method", ["linear", "spline"])
def test_values_may_be_expressions(method: str) -> None:
    """The look-up is linear in its values: with symbols for them it gives the same, and its slope in them is the basis,
    which sums to one."""
    rng = np.random.default_rng(7)
    grid = drawn(rng, (5, 4), method=method)
    x, knots = ca.SX.sym("x", 2), ca.SX.sym("knots", 20)
    value = grid.at(x[0], x[1], values=ca.vertsplit(knots))
    both = ca.Function("both", [x, knots], [value, ca.sum2(ca.jacobian(value, knots))])
    for point in rng.uniform(-0.9, 0.9, (20, 2)):
        found, basis = both(point, grid.values)
        assert float(found) == pytest.approx(float(function(grid)(point)), abs=1e-12)
        assert float(basis) == pytest.approx(1.0, abs=1e-12)


def test_two_equal_breakpoints_are_a_step() -> None:
    grid = Grid(breakpoints=((0.0, 1.0, 1.0, 2.0),), values=(0.0, 1.0, 5.0, 6.0))
    look_up = function(grid)
    assert [float(look_up(x)) for x in (0.5, 0.999999, 1.000001, 1.5)] == pytest.approx([0.5, 1.0, 5.0, 5.5], abs=2e-6)


@pytest.mark.parametrize(
    ("breakpoints", "values", "options", "message"),
    [
        (((0.0, 1.0),), (1.0,), {}, "2 breakpoints need 2 values, got 1"),
        (((1.0, 0.0),), (1.0, 2.0), {}, "axis 1: breakpoints must ascend, got 1 before 0"),
        (((0.0, 1.0),), (1.0, float("nan")), {}, "expected a finite number"),
        (((0.0, 1.0, 2.0),), (1.0, 2.0, 3.0), {"method": "spline"}, "axis 1 has 3 breakpoints; a spline table needs 4"),
        (((0.0, 1.0),), (1.0, 2.0), {"method": "cubic"}, "method is the text 'cubic'"),
        (((0.0, 1.0),), (1.0, 2.0), {"outside": "holds"}, "did you mean 'hold'"),
        ((), (1.0,), {}, "one to three axes"),
    ],
)
def test_what_cannot_be_is_named(breakpoints: tuple, values: tuple, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Grid(breakpoints=breakpoints, values=values, **options)
