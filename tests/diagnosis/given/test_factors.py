"""Factors common to many derivatives. Truth: the numbers of the file that were made wrong."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from small_flight import records

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.given.contradicted import FlightValue
from casid.diagnosis.given.factors import borne_out, common_factors
from casid.diagnosis.given.scope import scope_of
from casid.model.causes.loading import moment_reference
from casid.model.dynamics import aircraft_model
from casid.model.plausible import Doubt
from casid.model.tables import table
from problems.do328 import do328

FILE = do328()


def flown(scale: dict[str, float], std: float = 0.01) -> dict[str, FlightValue]:
    """What flight says of every derivative: the file's value times a factor, 1 % known."""
    return {
        name: FlightValue(value=value * scale.get(name, 1.0), std=std * abs(value), determined=True)
        for name, value in FILE.derivatives.items()
        if value
    }


def of(*coefficients: str) -> dict[str, float]:
    return {n: 2.07 for n in FILE.derivatives if n.split("_")[0] in coefficients and not n.endswith("_0")}


def test_a_wrong_inertia_is_one_factor_on_its_row() -> None:
    """Iyy 2.07 times the true one: every pitching derivative is estimated 2.07 times too large."""
    (found,) = common_factors(FILE, flown(of("Cm")))
    assert found.row == "Cm" and found.means[0] == "Iyy"
    assert found.factor == pytest.approx(2.07, abs=3.0 * found.std)
    assert set(found.derivatives) == set(of("Cm"))


def test_a_wrong_mass_is_one_factor_on_the_forces() -> None:
    (found,) = common_factors(FILE, flown(of("CL", "CD", "CY")))
    assert found.row == "all forces" and found.means[0] == "the mass"


def test_a_wrong_gearing_is_one_factor_on_a_surface() -> None:
    scale = {name: 0.7 for name in FILE.derivatives if name.endswith("_delta_a")}
    (found,) = common_factors(FILE, flown(scale))
    assert "delta_a" in found.row and found.factor == pytest.approx(0.7, abs=3.0 * found.std)


@pytest.mark.parametrize(("variables", "row"), [("pr", "the lateral rates"), ("q", "the pitch rate")])
def test_a_wrong_rate_length_is_one_factor_on_a_column(variables: str, row: str) -> None:
    scale = {name: 2.0 for name in FILE.derivatives if name.split("_", 1)[1] in variables}
    (found,) = common_factors(FILE, flown(scale, 0.03))
    assert row in found.row and found.factor == pytest.approx(2.0, abs=3.0 * found.std)


def test_errors_that_have_nothing_to_do_with_each_other_are_no_factor() -> None:
    """Each derivative is off by its own error of 20 %, as the file states: a pair is alike by chance now and then."""
    told = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        scale = {name: float(np.exp(0.2 * rng.standard_normal())) for name in FILE.derivatives}
        told += len(common_factors(replace(FILE, relative_uncertainty=0.2), flown(scale, 0.02)))
    assert told <= 2  # of 200 files


def test_a_file_that_is_right_has_no_factor() -> None:
    assert common_factors(FILE, flown({})) == ()


def test_one_wrong_derivative_is_no_factor() -> None:
    assert common_factors(FILE, flown({"Cm_alpha": 2.0})) == ()


def test_derivatives_that_disagree_have_no_factor() -> None:
    names = [name for name in of("Cm")]
    scale = {name: 1.5 + 0.8 * k for k, name in enumerate(names)}
    assert all(one.row != "Cm" for one in common_factors(FILE, flown(scale)))


def test_what_flight_does_not_determine_says_nothing() -> None:
    loose = {name: replace(one, determined=False) for name, one in flown(of("Cm")).items()}
    assert common_factors(FILE, loose) == ()


@pytest.mark.parametrize(("factor", "said"), [(0.3048, True), (0.82, False), (1.0, False)])
def test_a_unit_is_said_only_when_all_that_it_touches_comes_near(factor: float, said: bool) -> None:
    """A business jet with derivatives at 0.8 of the file was told that its lengths in pitch were in ft."""
    doubt = Doubt(parameter="lengths in pitch", given=2.0, unit="m", sentence="in ft")
    names = [name for name in FILE.derivatives if name.startswith("Cm_") and not name.endswith("_0")]
    rates = {name: factor if name.endswith("_q") else 1.0 for name in FILE.derivatives}
    scale = {name: rates.get(name, 1.0) * (factor if name in names else 1.0) for name in FILE.derivatives}
    assert borne_out((doubt,), FILE, flown(scale)) == ((doubt,) if said else ())


def test_a_unit_is_refuted_alike_by_a_derivative_and_by_a_table_with_the_same_slope() -> None:
    """Truth: the same aircraft, with its pitching moment over the angle of attack as a derivative or as a table on
    which the derivative is an increment of zero. Flight confirms it, so its length in pitch is in m."""
    doubt = Doubt(parameter="lengths in pitch", given=2.0, unit="m", sentence="in ft")
    own = {**FILE.derivatives, "Cm_alpha": 0.0}
    straight = table("Cm", "alpha", [-1.0, 1.0], [-FILE.derivatives["Cm_alpha"], FILE.derivatives["Cm_alpha"]])
    known = {name: replace(one, determined=name == "Cm_alpha") for name, one in flown({}).items()}
    as_increment = {**known, "Cm_alpha": FlightValue(value=0.0, std=0.01, determined=True)}
    files = [(FILE, known), (replace(FILE, derivatives=own, tables=(straight,)), as_increment)]
    for aircraft, values in files:
        scope = scope_of(aircraft, (records(), records()), Criteria(), None)
        assert scope.borne_out((doubt,), aircraft, values) == ()


def test_a_doubt_that_is_no_unit_stays() -> None:
    doubt = Doubt(parameter="trim rho", given=12.0, unit="kg/m3", sentence="no air is that dense")
    assert borne_out((doubt,), FILE, flown({})) == (doubt,)


def about(x: float) -> dict[str, FlightValue]:
    """What flight says where the moments of the file are about a point x ahead of the centre of gravity."""
    moved = flown({})
    beside = {"Cm": ("CL", FILE.moment_length_pitch), "Cn": ("CY", FILE.moment_length_lateral)}
    for name, one in moved.items():
        force, length = beside.get(name[:2], ("", 1.0))
        moved[name] = replace(one, value=one.value + x * FILE.derivatives.get(force + name[2:], 0.0) / length)
    return moved


@pytest.mark.parametrize("x", [-0.4, 0.3])
def test_moments_about_another_point_are_one_distance(x: float) -> None:
    """Every moment differs by the force of the same variable times the distance."""
    (found,) = common_factors(FILE, about(x))
    assert found.cause == "moment_reference(x)" and found.unit == "m"
    assert found.factor == pytest.approx(x, abs=3.0 * found.std)
    assert {"Cm_alpha", "Cn_beta"} <= set(found.derivatives)


def test_one_moment_that_differs_alone_is_no_other_point() -> None:
    """If only Cm_alpha moved, Cn_beta and Cm_delta_e speak against a point of reference."""
    assert common_factors(FILE, flown({"Cm_alpha": 1.5, "Cm_delta_e": 1.2})) == ()


def test_the_cause_is_the_cross_product_of_its_distance_and_the_force() -> None:
    """A trimmed flight with it turns by M / I more: the normal force times the distance."""
    model = aircraft_model(FILE, effects=[moment_reference("x")])
    names = [*model.states]
    rates = ca.Function("rates", [model.x, model.u, model.p, model.w], [model.f])
    state = np.array([FILE.trim.get("V", 100.0) if n == "u" else 10.0 if n == "w" else 0.0 for n in names])
    inputs = np.array([FILE.trim.get("rho", 1.0) if n == "rho" else 0.0 for n in model.inputs])
    at = {name: list(model.parameters).index(name) for name in model.parameters}

    def flown_with(x: float) -> np.ndarray:
        values = model.nominal_vector().copy()
        values[at["moment_reference(x)"]] = x
        return np.asarray(rates(state, inputs, values, np.zeros(len(model.disturbances)))).ravel()

    more = flown_with(0.1) - flown_with(0.0)
    still = flown_with(0.0)
    turned = still[names.index("w")] - FILE.gravity + state[names.index("u")] * 0.0  # specific force along z, no rates
    assert more[names.index("q")] == pytest.approx(-0.1 * FILE.mass * turned / FILE.inertia.Iyy, rel=1e-6)
    assert more[names.index("w")] == 0.0


@pytest.mark.parametrize(("surface", "rate"), [("delta_r", "r"), ("delta_a", "p")])
def test_a_damper_that_the_model_lacks_is_one_gain(surface: str, rate: str) -> None:
    """The surface follows the rate with 0.4 s: every derivative in the rate has 0.4 s V / l of that in the surface."""
    moved, per = flown({}), FILE.trim["V"] / FILE.rate_length_lateral
    for name, one in moved.items():
        if name.endswith(f"_{rate}"):
            power = FILE.derivatives.get(name.replace(f"_{rate}", f"_{surface}"), 0.0)
            moved[name] = replace(one, value=one.value + 0.4 * per * power)
    (found,) = common_factors(FILE, moved)
    assert found.row == f"{surface} follows {rate}" and found.unit == "s"
    assert found.factor == pytest.approx(0.4, abs=3.0 * found.std)
