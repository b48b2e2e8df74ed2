"""State-space fits to frequency responses against analytic responses of the same matrices, and precision against H."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import START, TRUTH, matrices, short_period
from small_flight import aircraft_file

import casid as cs
from casid.errors import EstimationError, InputError
from casid.frequency.model_response import sensitivity_at

OMEGA = np.geomspace(0.4, 15.0, 25)


def measured(tau: float = 0.0) -> list[cs.MeasuredResponse]:
    """alpha and q to the elevator by the inverse of a 2 x 2 matrix, and a delay [s]."""
    a, b = matrices(TRUTH)
    s = 1j * OMEGA
    determinant = (s - a[0, 0]) * (s - a[1, 1]) - a[0, 1] * a[1, 0]
    alpha = ((s - a[1, 1]) * b[0, 0] + a[0, 1] * b[1, 0]) / determinant
    q = ((s - a[0, 0]) * b[1, 0] + a[1, 0] * b[0, 0]) / determinant
    return [
        cs.MeasuredResponse(input="delta_e", output=o, omega=OMEGA, response=response * np.exp(-tau * s))
        for o, response in (("alpha", alpha), ("q", q))
    ]


def test_analytic_responses_give_all_entries_and_the_delay_to_rounding() -> None:
    fit = cs.fit_state_space(short_period(START), measured(0.08), free=["*"], delays=["delta_e"])
    assert fit.converged
    assert fit.values == pytest.approx(TRUTH | {"tau_delta_e": 0.08}, rel=1e-7)
    assert fit.cost < 1e-15


def test_what_is_fixed_stays_as_given() -> None:
    fit = cs.fit_state_space(
        short_period(START),
        measured(0.08),
        free=["M*", "Za"],
        delays=["delta_e", "q"],
        fixed={"Zde": TRUTH["Zde"], "tau_delta_e": 0.05},
    )
    assert set(fit.parameters) == {"Ma", "Mq", "Mde", "Za", "tau_q"}
    # alpha is too early by 0.03 s and cannot be made up for; q can
    assert fit.costs["q/delta_e"] < fit.costs["alpha/delta_e"]
    alone = cs.fit_state_space(
        short_period(START),
        measured(0.08)[1],
        free=["M*"],
        delays=["delta_e"],
        fixed={n: TRUTH[n] for n in ("Za", "Zde")},
    )
    assert alone["tau_delta_e"].value == pytest.approx(0.08, rel=1e-7)


def test_sensitivities_of_an_aircraft_are_those_of_differences() -> None:
    aircraft = aircraft_file()
    model, level = cs.aircraft_model(aircraft, axes="longitudinal"), cs.trim(aircraft, V=120.0, altitude=3000.0)
    names = ["Cm_alpha", "Cm_q", "CL_alpha"]
    free = np.array([model.parameters.index(n) for n in names])
    point = cs.linear_model(model, level).point
    x, u = (np.array([point[n] for n in group]) for group in (model.states, model.inputs))

    def at(p: np.ndarray):
        return sensitivity_at(model, free, x, u, p)

    p = model.nominal_vector()
    held = np.zeros(len(u), dtype=bool)
    _, slopes = at(p).response(OMEGA)
    _, moved = at(p).sampled(0.02, held)
    for i, k in enumerate(free):
        step = np.zeros(len(p))
        step[k] = 1e-5 * abs(p[k])
        up, down = at(p + step), at(p - step)
        difference = (up.response(OMEGA)[0] - down.response(OMEGA)[0]) / (2.0 * step[k])
        assert slopes[:, i] == pytest.approx(difference, rel=1e-5, abs=1e-6 * np.abs(difference).max())
        difference = (up.sampled(0.02, held)[0] - down.sampled(0.02, held)[0]) / (2.0 * step[k])
        assert moved[i] == pytest.approx(difference, rel=1e-5, abs=1e-6 * np.abs(difference).max())


def test_an_aircraft_is_found_from_the_responses_of_its_own_linear_model() -> None:
    aircraft = aircraft_file()
    model, level = cs.aircraft_model(aircraft, axes="longitudinal"), cs.trim(aircraft, V=120.0, altitude=3000.0)
    names = ["Cm_alpha", "Cm_q", "Cm_delta_e", "CL_alpha"]
    linear = cs.linear_model(model, level)
    responses = [
        cs.MeasuredResponse(
            input="delta_e", output=o, omega=OMEGA, response=linear.response("delta_e", o, OMEGA, delay=0.05)
        )
        for o in ("q", "alpha", "az")
    ]
    start = {n: 1.3 * model.nominal[n] for n in names}
    fit = cs.fit_state_space(model, responses, free=names, at=level, start=start, delays=["delta_e"])
    assert fit.values == pytest.approx({n: model.nominal[n] for n in names} | {"tau_delta_e": 0.05}, rel=1e-6)


def test_wrong_names_are_errors() -> None:
    model = short_period(START)
    with pytest.raises(InputError, match="unknown parameter .Mb."):
        cs.fit_state_space(model, measured(), free=["Mb"])
    with pytest.raises(InputError, match="unknown output 'theta'"):
        cs.fit_state_space(
            model, cs.MeasuredResponse(input="delta_e", output="theta", omega=OMEGA, response=OMEGA + 1j), free=["*"]
        )
    with pytest.raises(InputError, match="delays"):
        cs.fit_state_space(model, measured(), free=["*"], delays=["delta_r"])
    aircraft = cs.aircraft_model(aircraft_file(), axes="longitudinal")
    level = cs.trim(aircraft_file(), V=120.0, altitude=3000.0)
    q = cs.MeasuredResponse(input="delta_e", output="q", omega=OMEGA, response=OMEGA + 1j)
    with pytest.raises(EstimationError, match="bias_q"):
        cs.fit_state_space(aircraft, q, free=["Cm_q", "bias_q"], at=level)
