"""Aircraft whose coefficients are tables or functions: the same physics as derivatives, where these say the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from small_flight import HIDDEN, records

import casid as cs
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.flown_records import default_free, flown_records, with_estimates
from casid.model.system import Model
from problems.do328 import do328

STATE = (94.0, 3.0, 7.0, 0.1, -0.05, 0.08, 0.2, 0.1)


def rates(model: Model, values: dict[str, float] | None = None) -> np.ndarray:
    """States' rates, outputs and equation-error prediction at one motion."""
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    inputs = {"delta_e": -0.03, "delta_a": 0.02, "delta_r": 0.01, "thrust": 9000.0, "rho": 0.9}
    inputs = [inputs[name] for name in model.inputs]
    return f(STATE, inputs, model.nominal_vector(values), np.zeros(len(model.disturbances))).full()[:, 0]


def as_tables(aircraft: Aircraft, **options: object) -> Aircraft:
    """Every derivative of an aircraft as a table over its regressor; of a rate, as one over alpha times the rate."""
    tables = []
    for name, value in aircraft.derivatives.items():
        coefficient, regressor = name.split("_", 1)
        if regressor == "0":
            tables.append(cs.table(coefficient, "mach", [0.0, 1.0], [value, value], name=name))
        elif regressor in "pqr":
            tables.append(cs.table(coefficient, "alpha", [-1.0, 1.0], [value, value], times=regressor, name=name))
        else:
            points = np.linspace(-0.9, 0.9, 5)
            tables.append(cs.table(coefficient, regressor, points.tolist(), value * points, name=name, **options))
    return replace(aircraft, derivatives={}, tables=tuple(tables))


@pytest.mark.parametrize("options", [{}, {"method": "spline"}, {"outside": "linear"}, {"free": True}])
def test_tables_of_a_linear_aircraft_fly_like_it(options: dict) -> None:
    linear = do328()
    np.testing.assert_allclose(
        rates(aircraft_model(as_tables(linear, **options))), rates(aircraft_model(linear)), rtol=1e-12, atol=1e-12
    )


def test_a_function_of_the_regressors_flies_like_its_derivatives() -> None:
    """Also what it makes of the rates of the flow angles, which is exact where terms are so to first order: with a
    small Cm_alphadot, which acts on no velocity, both are the same."""
    linear = do328().with_derivatives({"Cm_alphadot": -9.0, "Cn_betadot": 0.02})

    def aerodynamics(s: SimpleNamespace) -> dict[str, object]:
        total: dict[str, object] = {}
        for name, value in linear.derivatives.items():
            coefficient, regressor = name.split("_", 1)
            part = value * (1.0 if regressor == "0" else getattr(s, regressor))
            total[coefficient] = total.get(coefficient, 0.0) + part
        return total

    own = replace(linear, derivatives={}, aerodynamics=aerodynamics)
    np.testing.assert_allclose(rates(aircraft_model(own)), rates(aircraft_model(linear)), rtol=1e-12, atol=1e-12)


def test_rates_of_flow_angles_are_consistent_with_the_lift_that_they_make() -> None:
    """CL_alphadot moves wdot and so alphadot itself: the model's coefficient must be that of the alphadot it flies."""
    seen = {}

    def aerodynamics(s: SimpleNamespace) -> dict[str, object]:
        seen["alphadot"] = s.alphadot
        return {"CL": 0.3 + 5.0 * s.alpha + 60.0 * s.alphadot, "CD": 0.03, "CY": 2.0 * s.betadot, "Cm": -s.alpha}

    own = replace(do328(), derivatives={}, aerodynamics=aerodynamics)
    model = aircraft_model(own)
    u, v, w = STATE[:3]
    V2 = u**2 + v**2 + w**2
    udot, vdot, wdot = rates(model)[:3]
    alphadot = (u * wdot - w * udot) / (u**2 + w**2) * own.rate_length_pitch / np.sqrt(V2)
    betadot = (vdot - v * (u * udot + v * vdot + w * wdot) / V2) / np.hypot(u, w) * own.rate_length_lateral / V2**0.5
    qS = 0.5 * 0.9 * V2 * own.area
    ax, ay, az = rates(model)[[model.outputs.index(a) + 8 for a in ("ax", "ay", "az")]]
    alpha = np.arctan2(w, u)
    lift = ((own.mass * ax - 9000.0) * np.sin(alpha) - own.mass * az * np.cos(alpha)) / qS
    assert lift == pytest.approx(0.3 + 5.0 * alpha + 60.0 * alphadot, rel=1e-10)
    assert own.mass * ay / qS == pytest.approx(2.0 * betadot, rel=1e-9)


def test_knots_are_parameters_and_come_back_into_the_file() -> None:
    free = cs.table("Cm", ["alpha"], [-0.2, 0.0, 0.2], [0.1, 0.0, -0.2], name="Cm_static", free=True)
    aircraft = replace(do328(), tables=(free,))
    model = aircraft_model(aircraft)
    assert model.nominal["Cm_static(2)"] == -0.2 and model.units["Cm_static(0)"] == "1"
    moved = with_estimates(aircraft, {"Cm_static(2)": -0.3}, {})
    assert moved.tables[0].grid.values == (0.1, 0.0, -0.3)
    np.testing.assert_allclose(rates(aircraft_model(moved)), rates(model, {"Cm_static(2)": -0.3}), rtol=1e-13)


def test_knots_are_found_again_from_a_flight() -> None:
    """Free values of a table of Cm over alpha, from records flown with a parabola."""
    points, truth = np.array([-0.06, 0.01, 0.08]), do328()
    known = {n: v for n, v in truth.derivatives.items() if n not in ("Cm_alpha", "Cm_0")}
    wrong = cs.table("Cm", "alpha", points.tolist(), -2.2 * points, name="Cm", free=True)
    applied = flown_records(replace(truth, derivatives=known, tables=(wrong,)), records())
    assert set(wrong.knots) <= set(default_free(applied))
    fit = cs.solve(cs.Problem(applied.model, applied.records, free=["Cm*"], cost=cs.OutputError()))
    a = truth.derivatives
    curve = a["Cm_0"] + a["Cm_alpha"] * points + HIDDEN * points**2
    sag = HIDDEN * (points[1] - points[0]) ** 2 / 4.0  # of a parabola below its chord
    np.testing.assert_allclose([fit.values[name] for name in wrong.knots], curve, atol=2.0 * sag)


def test_a_file_with_tables_is_read_back_equal(tmp_path: Path) -> None:
    tables = (
        cs.table("Cm", ["alpha", "delta_e"], [[-0.1, 0.2], [-0.3, 0.0, 0.3]], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]]),
        cs.table("Cn", "beta", [-1.0, 0.0, 0.5, 1.0], [0.1, 0.0, 0.0, 0.1], name="Cn b", method="spline", free=True),
        cs.table("CL", "mach", [0.0, 1.0], [4.0, 5.0], times="alpha", outside="linear"),
    )
    aircraft = replace(do328(), tables=tables)
    aircraft.write(tmp_path / "plane.toml")
    assert Aircraft.read(tmp_path / "plane.toml") == aircraft


def test_what_leaves_a_table_is_said() -> None:
    one = cs.table("Cm", ["alpha", "mach"], [[0.0, 0.1], [0.2, 0.8]], np.zeros((2, 2)), name="Cm")
    said = list(one.beyond({"alpha": np.array([-0.05, 0.05]), "mach": np.array([0.3])}))
    assert said == [
        "table Cm: alpha runs from -0.05 to 0.05, its breakpoints from 0 to 0.1: beyond them the last value is held"
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('coefficient = "Cm"\naxes = "alfa"\nbreakpoints = [0, 1]\nvalues = [0, 1]', "did you mean 'alpha'"),
        ('coefficient = "CX"\naxes = "alpha"\nbreakpoints = [0, 1]\nvalues = [0, 1]', "force_axes"),
        (
            'coefficient = "Cm"\naxes = "alpha"\nbreakpoints = [0, 1]\nvalues = [0, 1, 2]',
            "need 2 values, got 3",
        ),
        ('coefficient = "Cm"\naxes = "alpha"\nbreakpoints = [0, 1]\nvalues = [[0], [1, 2]]', "lists of numbers"),
        ('coefficient = "Cm"\naxes = "alpha"\nbreakpoints = 3\nvalues = [0, 1]', "breakpoints must be a list"),
        ('coefficient = "Cm"\naxes = ["alpha", "beta"]\nbreakpoints = [0, 1]\nvalues = [0, 1]', "1 axes"),
        ('coefficient = "Cm"\nbreakpoints = [0, 1]\nvalues = [0, 1]', "'axes' is missing"),
        ('coefficient = "Cm"\naxes = "alpha"\nbreakpoints = [0, 1]\nvalues = [0, 1]\nfree = 1', "true or false"),
    ],
)
def test_a_wrong_table_is_named(tmp_path: Path, text: str, message: str) -> None:
    do328().write(tmp_path / "plane.toml")
    with (tmp_path / "plane.toml").open("a") as file:
        file.write(f"\n[aerodynamics.tables.Cm_static]\n{text}\n")
    with pytest.raises(InputError, match=message):
        Aircraft.read(tmp_path / "plane.toml")


def test_a_function_that_asks_for_what_is_not_there_is_named() -> None:
    own = replace(do328(), derivatives={}, aerodynamics=lambda s: {"Cm": s.alfa})
    with pytest.raises(InputError, match="unknown quantity 'alfa'; did you mean 'alpha'"):
        aircraft_model(own)
    own = replace(do328(), derivatives={}, aerodynamics=lambda s: {"CM": s.alpha})
    with pytest.raises(InputError, match="unknown coefficient 'CM'"):
        aircraft_model(own)
