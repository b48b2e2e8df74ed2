"""The simulated aircraft of the paper: trim, control law, nonlinear terms, noise, manoeuvres, number of records."""

from __future__ import annotations

from collections import Counter

import casadi as ca
import numpy as np
import pytest

from casid.errors import InputError
from casid.model.dynamics import aircraft_model
from problems.do328 import MOMENT_DERIVATIVES, STABLE, do328
from problems.manoeuvres import MANOEUVRES, sample_times, stick
from problems.paper.cases import CASES, Condition, conditions, parse_cases, parse_manoeuvres
from problems.paper.nonlinear import EXCURSION, increments
from problems.paper.truth import (
    NOISE,
    OUTPUTS,
    SIGMAS_PER_AMPLITUDE,
    SURFACES,
    control_law,
    derivatives_of,
    fly,
    regressors,
    trim_point,
)


def test_table_1_has_384_records() -> None:
    """Truth: Table 1 of the paper, estimations per estimator."""
    counts = Counter(c.case for c in conditions(CASES, MANOEUVRES))
    assert list(counts.values()) == [8, 40, 8, 40, 24, 120, 24, 120]
    assert len({c.name for c in conditions(CASES, MANOEUVRES)}) == 384


def test_trim_carries_the_weight_and_balances_the_thrust() -> None:
    """Truth: L + T sin(alpha) = m g and D = T cos(alpha) in level flight, pitching moment zero; V of Table 2."""
    at, d, aircraft = trim_point(), STABLE, do328()
    qS = 0.5 * at.rho * 144.0**2 * 40.0
    lift = qS * (d["CL_0"] + d["CL_alpha"] * at.alpha + d["CL_delta_e"] * at.delta_e)
    drag = qS * (d["CD_0"] + d["CD_alpha"] * at.alpha)
    assert lift + 10e3 * np.sin(at.alpha) == pytest.approx(10500 * aircraft.gravity, rel=1e-9)
    assert drag == pytest.approx(10e3 * np.cos(at.alpha), rel=1e-9)
    assert d["Cm_0"] + d["Cm_alpha"] * at.alpha + d["Cm_delta_e"] * at.delta_e == pytest.approx(0.0, abs=1e-9)


def test_control_law_gives_the_stable_moments() -> None:
    """Truth: eq. 16 is made so that Cm, Cl, Cn of the destabilised aircraft with law are those of the stable one."""
    model, rng = aircraft_model(do328(), outputs=OUTPUTS, effects=()), np.random.default_rng(1)
    law, seen = control_law(model), regressors(model)
    x = trim_point().state + rng.standard_normal(8) * [5, 5, 5, 0.3, 0.1, 0.1, 0.2, 0.1]
    u = np.array([0.02, -0.05, 0.04, 1e4, 0.9])

    def moments(derivatives: dict[str, float], surfaces: ca.SX) -> np.ndarray:
        terms = {name: ca.substitute(s, model.u, surfaces) for name, s in seen.items()} | {"0": ca.SX(1)}
        sums = [
            sum(derivatives[n] * terms[n.split("_", 1)[1]] for n in MOMENT_DERIVATIVES if n.startswith(c))
            for c in ("Cl", "Cm", "Cn")
        ]
        return ca.Function("m", [model.x, model.u], [ca.vertcat(*sums)])(x, u).full()[:, 0]

    np.testing.assert_allclose(
        moments(derivatives_of(True), law.received), moments(derivatives_of(False), model.u), atol=1e-14
    )


def test_variant_3_is_variant_2_doubled_and_variant_0_nothing() -> None:
    x = {name: ca.DM(0.3 * size) for name, size in EXCURSION.items()}
    second, third = increments(2, x, STABLE), increments(3, x, STABLE)
    assert increments(0, x, STABLE) == {}
    for name, value in second.items():
        assert float(third[name]) == pytest.approx(2.0 * float(value), rel=1e-14)
        assert float(value) != 0.0


def test_variant_1_bends_every_force_and_moment_term() -> None:
    x = {name: ca.DM(0.3 * size) for name, size in EXCURSION.items()}
    found = increments(1, x, STABLE)
    linear = {name for name in STABLE if not name.endswith("_0")}
    assert set(found) == linear
    assert {n for n in linear if float(found[n]) == 0.0} == {n for n in linear if STABLE[n] == 0.0}


@pytest.mark.parametrize("variant", [1, 2, 3])
def test_contributions_add_up_to_the_moments_that_move_the_aircraft(variant: int) -> None:
    """Truth: Euler's equation I domega/dt + omega x I omega = M, with domega/dt from the simulated rates."""
    flight = fly(Condition(case="G", manoeuvre=4, variant=variant))
    for c, values in flight.coefficients.items():
        total = sum(flight.contributions[n] for n in MOMENT_DERIVATIVES if n.startswith(c))
        np.testing.assert_allclose(total, values, atol=1e-15)
    e, inertia = flight.exact, do328().inertia
    p, q, r = (e[n] for n in "pqr")
    M = 0.5 * e["rho"] * e["V"] ** 2 * 40.0 * 2.04 * flight.coefficients["Cm"]
    slope = (M - (inertia.Ixx - inertia.Izz) * p * r - inertia.Ixz * (p**2 - r**2)) / inertia.Iyy
    # surfaces are held over a sample: the slope at its start moves q by slope * dt, up to dt^2/2 times its change
    moved = np.diff(q) / 0.02
    assert np.abs(moved - slope[:-1]).max() < 0.1 * np.abs(slope).max()
    assert np.corrcoef(moved, slope[:-1])[0, 1] > 0.995


def test_noise_has_the_amplitudes_of_table_4() -> None:
    """Truth: Table 4; the standard deviation of N samples is known to 1/sqrt(2N), five of them allowed."""
    flight = fly(Condition(case="B", manoeuvre=2, seed=3))
    for name, relative in NOISE.items():
        true = flight.exact[name]
        size = np.abs(true).max() if name == "V" else np.abs(true - true[0]).max()
        found = np.std(flight.surfaces[name] - true) / size * SIGMAS_PER_AMPLITUDE
        assert found == pytest.approx(relative, rel=5 / np.sqrt(2 * len(true)))


def test_same_seed_same_numbers_other_seed_other_noise() -> None:
    first, again, other = (fly(Condition(case="D", manoeuvre=1, seed=s)) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.surfaces["q"], again.surfaces["q"])
    np.testing.assert_array_equal(first.exact["q"], other.exact["q"])
    difference = first.surfaces["q"] - other.surfaces["q"]
    assert np.corrcoef(first.surfaces["q"] - first.exact["q"], difference)[0, 1] < 0.8


def test_commands_and_surfaces_are_one_without_a_control_law() -> None:
    flight = fly(Condition(case="B", manoeuvre=1, seed=1))
    for name in SURFACES:
        np.testing.assert_array_equal(flight.commands[name], flight.surfaces[name])


@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_manoeuvres_start_steady_move_all_axes_and_end(manoeuvre: int) -> None:
    t = sample_times()
    moved = stick(manoeuvre, t)
    assert not moved[t < 0.99].any() and not moved[-1].any()
    assert (np.abs(moved).max(axis=0) > 0.02).all()
    # whole cycles, to plus and minus alike: no axis is left with a mean that would turn the aircraft over
    assert (np.abs(moved.mean(axis=0)) < 0.02 * np.abs(moved).max(axis=0)).all()


def test_names_of_cases_and_manoeuvres() -> None:
    assert parse_cases("A..H") == tuple("ABCDEFGH")
    assert parse_cases("h,a") == ("A", "H") and parse_cases("CF") == ("C", "F")
    assert parse_manoeuvres("1..8") == tuple(range(1, 9)) and parse_manoeuvres("3,1") == (1, 3)
    for bad in ("", "J", "H..A", "A..J"):
        with pytest.raises(InputError, match="expected letters of A to H"):
            parse_cases(bad)
    for bad in ("", "0", "1..9", "x"):
        with pytest.raises(InputError, match="expected numbers of 1 to 8"):
            parse_manoeuvres(bad)
