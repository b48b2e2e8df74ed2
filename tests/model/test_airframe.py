"""Inertia of an aircraft that is not symmetric: the truth is Euler's equation with its whole tensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model.airframe import Inertia, unsymmetric_moment
from problems.do328 import do328

LOPSIDED = Inertia(Ixx=1.2e5, Iyy=2.1e5, Izz=3.0e5, Ixz=1.5e4, Ixy=1.1e4, Iyz=-0.9e4)
STATE = (94.0, 3.0, 7.0, 0.3, -0.2, 0.25, 0.2, 0.1)


def rates(aircraft: cs.Aircraft) -> np.ndarray:
    model = cs.aircraft_model(aircraft)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    inputs = {"delta_e": -0.03, "delta_a": 0.02, "delta_r": 0.01, "thrust": 9000.0, "rho": 0.9}
    at = [inputs[name] for name in model.inputs]
    return f(STATE, at, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0]


def test_rotation_is_eulers_with_the_whole_tensor() -> None:
    aircraft = do328()
    omega, J = np.array(STATE[3:6]), aircraft.inertia.tensor
    moment = J @ rates(aircraft)[3:6] + np.cross(omega, J @ omega)
    lopsided = rates(replace(aircraft, inertia=LOPSIDED))[3:6]
    J = LOPSIDED.tensor
    np.testing.assert_allclose(lopsided, np.linalg.solve(J, moment - np.cross(omega, J @ omega)), rtol=1e-11)


def test_what_the_products_add_is_the_difference_of_two_moments() -> None:
    rng = np.random.default_rng(3)
    omega, turned = rng.normal(size=(2, 3))
    plain = replace(LOPSIDED, Ixy=0.0, Iyz=0.0)
    moments = [J @ turned + np.cross(omega, J @ omega) for J in (LOPSIDED.tensor, plain.tensor)]
    added = unsymmetric_moment({"Ixy": LOPSIDED.Ixy, "Iyz": LOPSIDED.Iyz}, list(omega), list(turned))
    np.testing.assert_allclose(added, moments[0] - moments[1], rtol=1e-9, atol=1e-6)


def test_equation_error_takes_the_same_tensor() -> None:
    """What its coefficients are from the accelerations that the model itself has."""
    aircraft = replace(do328(), inertia=LOPSIDED)
    model = cs.aircraft_model(aircraft)
    assert model.equation is not None
    own = ca.Function("own", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    inputs = {"delta_e": -0.03, "delta_a": 0.02, "delta_r": 0.01, "thrust": 9000.0, "rho": 0.9}
    at, p = [inputs[name] for name in model.inputs], model.nominal_vector()
    found = own(STATE, at, p, np.zeros(len(model.disturbances))).full()[:, 0]
    seen = dict(zip((*model.states, *model.outputs), found, strict=True)) | inputs
    m = [seen[name] for name in model.equation.channels]
    both = ca.Function("both", [model.equation.m, model.p], [model.equation.target, model.equation.prediction])
    target, prediction = both(m, p)
    np.testing.assert_allclose(target.full(), prediction.full(), rtol=1e-9, atol=1e-9)


def test_a_file_keeps_it_and_a_tensor_that_no_body_has_is_refused(tmp_path: Path) -> None:
    aircraft = replace(do328(), inertia=LOPSIDED)
    aircraft.write(tmp_path / "plane.toml")
    assert cs.Aircraft.read(tmp_path / "plane.toml") == aircraft
    do328().write(tmp_path / "symmetric.toml")
    assert "Ixy" not in (tmp_path / "symmetric.toml").read_text()
    with pytest.raises(InputError, match="not positive definite"):
        replace(LOPSIDED, Ixy=2e5)
    assert replace(LOPSIDED, Ixx=2e4, Iyz=0.0).notes
