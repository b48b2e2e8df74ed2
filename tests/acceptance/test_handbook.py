"""Handbook numbers against textbooks, analytic margins, differences, and Monte Carlo."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.acceptance.glide import GLIDE
from casid.acceptance.handbook import flight_point, handbook, labelled
from casid.acceptance.parameters import Known, known_by_document, known_by_estimate, known_by_file
from casid.acceptance.steady import SteadyFlight
from casid.cli.options import DEMO
from casid.model.aircraft import EffectValue
from casid.model.flown_records import flown_records, with_estimates
from casid.signals import FOOT, SLUG
from tests.acceptance.textbook import BOEING_747_LONGITUDINAL, NAVION_LONGITUDINAL, boeing_747, navion

NAMES = ["short period", "phugoid", "dutch roll", "roll", "spiral"]


def near(value: complex, truth: complex, part: float) -> None:
    assert abs(value - truth) < part * abs(truth), (value, truth)


def upper(matrix: np.ndarray) -> list[complex]:
    """Eigenvalues in the upper half plane, fastest first."""
    return sorted((v for v in np.linalg.eigvals(matrix) if v.imag >= 0.0), key=lambda v: -abs(v))


@pytest.mark.parametrize(
    ("aircraft", "matrix", "part"),
    [(navion(), NAVION_LONGITUDINAL, 0.02), (boeing_747(), BOEING_747_LONGITUDINAL, 0.005)],
)
def test_longitudinal_modes_are_those_of_the_printed_system_matrix(aircraft, matrix, part) -> None:
    """Derivatives of the book in, eigenvalues of the matrix that the book prints out, to the digits that it prints."""
    found = cs.modes(aircraft)
    for name, truth in zip(NAMES[:2], upper(matrix), strict=True):
        near(found.modes[name].eigenvalue, truth, part)


def test_lateral_modes_are_those_of_the_formulas() -> None:
    """Dimensional derivatives of Nelson, table 5.1, about level flight without product of inertia."""
    a = navion()
    found = cs.modes(a)
    V, rho, b, d = found.flight["V"], found.flight["rho"], a.moment_length_lateral, a.derivatives
    qS = 0.5 * rho * V**2 * a.area
    by_rate = b / (2.0 * V)

    def row(roll: str, inertia: float) -> list[float]:
        size = qS * b / inertia
        return [size * d[f"{roll}_beta"] / V, size * d[f"{roll}_p"] * by_rate, size * d[f"{roll}_r"] * by_rate, 0.0]

    matrix = np.array(
        [
            [qS * d["CY_beta"] / (a.mass * V), 0.0, -V, a.gravity],
            row("Cl", a.inertia.Ixx),
            row("Cn", a.inertia.Izz),
            [0.0, 1.0, 0.0, 0.0],
        ]
    )
    truth = np.linalg.eigvals(matrix)
    pair = truth[truth.imag > 0.0][0]
    roll, spiral = sorted(truth[truth.imag == 0.0].real)
    near(found.modes["dutch roll"].eigenvalue, pair, 0.005)  # the file's trim has an angle of attack of 0.06 deg
    near(found.modes["roll"].eigenvalue, roll, 0.001)
    near(found.modes["spiral"].eigenvalue, spiral, 0.03)


def test_modes_are_those_of_jsbsim_linearised(tmp_path) -> None:
    """The Navion in a glide, written for JSBSim, its accelerations differenced by state: within 0.3 % (its Earth is
    round and turns)."""
    jsbsim = pytest.importorskip("jsbsim")
    a = replace(navion(), terms={"CD": {"alpha^2": 1.0}})
    folder = tmp_path / "aircraft" / "plane"
    folder.mkdir(parents=True)
    cs.export(a, folder / "plane.xml", to="jsbsim")
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    fdm = jsbsim.FGFDMExec(str(tmp_path))
    fdm.set_debug_level(0)
    assert fdm.load_model("plane")
    fdm["ic/h-sl-ft"] = 3000.0
    fdm.run_ic()
    V, rho = 160.0 * FOOT, fdm["atmosphere/rho-slugs_ft3"] * SLUG / FOOT**3
    flight = SteadyFlight(a)
    glide = flight.solve(GLIDE, {"V": V, "rho": rho, "thrust": 0.0}, known_by_file(flight).values).values
    alpha = glide["alpha"]
    level = {"u-fps": 160.0 * np.cos(alpha), "v-fps": 0.0, "w-fps": 160.0 * np.sin(alpha)}
    level |= {f"{axis}-rad_sec": 0.0 for axis in "pqr"} | {"phi-rad": 0.0, "theta-rad": alpha + glide["climb_angle"]}
    fdm["fcs/elevator-cmd-norm"] = glide["delta_e"] / 0.3491

    def rates(name: str, change: float) -> np.ndarray:
        for key, value in level.items():
            fdm[f"ic/{key}"] = value + change * (key == name)
        fdm.run_ic()
        turning = [fdm[f"accelerations/{n}dot-rad_sec2"] for n in "pqr"]
        angles = [fdm[f"velocities/{n}dot-rad_sec"] for n in ("phi", "theta")]
        return np.array([*(fdm[f"accelerations/{n}dot-ft_sec2"] for n in "uvw"), *turning, *angles])

    columns = []
    for name in level:
        step = 0.1 if "fps" in name else 1e-3
        columns.append((rates(name, step) - rates(name, -step)) / (2.0 * step))
    truth = np.linalg.eigvals(np.array(columns).T)
    found = cs.modes(a, V=V, rho=rho, climb_angle=glide["climb_angle"])
    assert list(found.modes) == NAMES
    for mode in found.modes.values():
        near(mode.eigenvalue, min(truth, key=lambda value: abs(value - mode.eigenvalue)), 0.003)


def test_numbers_of_a_mode_follow_from_its_eigenvalue() -> None:
    found = cs.modes(DEMO / "aircraft.toml")
    assert list(found.modes) == NAMES
    for mode in found.modes.values():
        value, told = mode.eigenvalue, {name: one.value for name, one in mode.numbers.items()}
        if value.imag:
            assert told["natural_frequency"] == pytest.approx(abs(value))
            assert told["damping_ratio"] == pytest.approx(-value.real / abs(value))
            assert told["period"] * value.imag == pytest.approx(2.0 * np.pi)
        else:
            assert told["time_constant"] == pytest.approx(-1.0 / value.real)
        time = told["time_to_half" if value.real < 0.0 else "time_to_double"]
        assert np.exp(value.real * time) == pytest.approx(0.5 if value.real < 0.0 else 2.0)


def test_static_margin_of_a_linear_model_and_of_a_moved_centre_of_gravity() -> None:
    """-Cm_alpha / CL_alpha, whatever unsteady terms there are; less by what the centre of gravity moves back."""
    a = navion()
    found = cs.modes(a).numbers
    margin = 0.683 / 4.44
    assert found["static_margin"].value == pytest.approx(margin, rel=1e-9)
    body = cs.modes(boeing_747()).numbers["static_margin"].value
    assert body == pytest.approx(1.023 / 4.920, rel=1e-4)  # no drag: lift is -CZ at an angle of attack of nearly zero
    aft = a.with_effects([EffectValue(kind="cg_offset", target="x", value=-0.1)])
    moved = cs.modes(aft).numbers
    normal_to_body = 0.02  # the moment is that of the force along body z, which is lift within this part
    assert (found["neutral_point"].value - moved["neutral_point"].value) == pytest.approx(0.1, rel=normal_to_body)
    assert (found["manoeuvre_margin"].value - moved["manoeuvre_margin"].value) * a.moment_length_pitch == pytest.approx(
        0.1, rel=normal_to_body
    )


def test_elevator_by_load_factor_is_that_of_steady_pull_ups() -> None:
    """Solved as flights with a pitch rate: elevator and angle of attack that balance lift and moment at load n."""
    a = replace(navion(), terms={})
    found = cs.modes(a)
    V, qS = found.flight["V"], 0.5 * found.flight["rho"] * found.flight["V"] ** 2 * a.area
    d, weight, c = a.derivatives, a.mass * a.gravity, a.moment_length_pitch

    def elevator(n: float) -> float:
        q = (n - 1.0) * a.gravity / V * a.rate_length_pitch / V
        thrust = found.flight["thrust"]
        left = np.array([[d["CL_alpha"] + thrust / qS, d["CL_delta_e"]], [d["Cm_alpha"], d["Cm_delta_e"]]])
        right = [n * weight / qS - d["CL_0"], -d["Cm_q"] * q]
        return float(np.linalg.solve(left, right)[1])

    assert found.numbers["elevator_per_g"].value == pytest.approx(elevator(1.5) - elevator(0.5), rel=1e-3)
    manoeuvre = 0.683 / 4.44 + 9.96 * a.gravity * a.rate_length_pitch / V**2 * qS / weight
    assert found.numbers["manoeuvre_margin"].value == pytest.approx(manoeuvre, rel=0.01)
    assert c * found.numbers["static_margin"].value == pytest.approx(found.numbers["neutral_point"].value)


def test_best_glide_of_a_parabolic_polar() -> None:
    """CD = CD0 + k CL2: the best ratio is 1 / (2 sqrt(CD0 k)), at CL = sqrt(CD0 / k) (Anderson, Aircraft Performance
    and Design, 5.4)."""
    CD0, k, slope = 0.025, 0.05, 5.0
    a = navion()
    terms = {"CD": {"alpha^2": k * slope**2}}
    flat = {n: v for n, v in a.derivatives.items() if n[:2] not in ("CL", "CD")}
    a = replace(a, derivatives=flat | {"CL_alpha": slope, "CD_0": CD0}, terms=terms)
    found = cs.modes(a).numbers
    ratio = 1.0 / (2.0 * np.sqrt(CD0 * k))
    assert found["best_glide_ratio"].value == pytest.approx(ratio, rel=1e-9)
    angle = np.arctan(1.0 / ratio)
    lift = a.mass * a.gravity * np.cos(angle)
    V = np.sqrt(2.0 * lift / (a.trim["rho"] * a.area * np.sqrt(CD0 / k)))
    assert found["best_glide_speed"].value == pytest.approx(V, rel=1e-6)
    assert found["best_glide_sink_rate"].value == pytest.approx(V * np.sin(angle), rel=1e-6)


def test_best_glide_at_the_corner_of_a_table() -> None:
    """Drag is constant up to an angle of attack and rises steeply beyond: the glide is flattest at that angle."""
    corner, CD0 = 0.06, 0.03
    a = navion()
    flat = {n: v for n, v in a.derivatives.items() if n[:2] not in ("CL", "CD")}
    bend = cs.table("CD", "alpha", [-0.3, corner, 0.4], [CD0, CD0, CD0 + 1.0], name="drag")
    a = replace(a, derivatives=flat | {"CL_alpha": 5.0}, tables=(bend,), relative_uncertainty=0.01)
    found = cs.modes(a)
    assert found.numbers["best_glide_ratio"].value == pytest.approx(5.0 * corner / CD0, rel=1e-2)
    assert found.numbers["best_glide_ratio"].std > 0.0 and np.isnan(found.numbers["best_glide_speed"].std)
    assert any("corner" in note for note in found.notes)


def everything(flight: SteadyFlight, known: Known) -> dict[str, float]:
    found = handbook(flight, known, point_of(flight), np.array([60.0]))
    curves = {f"curve {n}": float(v[0]) for n, v in found.trim_curves.values.items()}
    return {label: one.value for label, one in labelled(found)} | curves


def deviations(flight: SteadyFlight, known: Known) -> dict[str, float]:
    found = handbook(flight, known, point_of(flight), np.array([60.0]))
    curves = {f"curve {n}": float(v[0]) for n, v in found.trim_curves.std.items()}
    return {label: one.std for label, one in labelled(found)} | curves


def covariance(known: Known) -> np.ndarray:
    assert known.covariance is not None
    return known.covariance


def point_of(flight: SteadyFlight) -> dict[str, float]:
    return flight_point(flight.aircraft, None, None, None) | {"climb_angle": 0.0}


def parabolic() -> cs.Aircraft:
    """An aircraft whose every number exists: a polar that is curved, a shifted centre of gravity."""
    a = navion()
    return replace(
        a,
        relative_uncertainty=0.02,
        terms={**a.terms, "CD": {"alpha^2": 1.2}},
        derivatives={**a.derivatives, "CL_q": 3.8},
    ).with_effects([EffectValue(kind="cg_offset", target="x", value=-0.05, std=0.01)])


def test_deviations_are_those_of_differences_of_the_whole_computation() -> None:
    """Each parameter moved a little, the trim, the matrix and the best glide solved again: sqrt(sum (dF/dp std)^2)."""
    flight = SteadyFlight(parabolic())
    known = known_by_file(flight)
    std = np.sqrt(np.diag(covariance(known)))
    square: dict[str, float] = {}
    for k in np.flatnonzero(std):
        step = np.zeros(len(std))
        step[k] = 1e-3 * std[k]
        ahead, behind = (everything(flight, replace(known, values=known.values + s)) for s in (step, -step))
        for name in ahead:
            square[name] = square.get(name, 0.0) + ((ahead[name] - behind[name]) / 2e-3) ** 2
    told = deviations(flight, known)
    assert told.keys() == square.keys()
    for name, value in told.items():
        assert value == pytest.approx(np.sqrt(square[name]), rel=1e-4, abs=1e-9), name


def test_estimated_deviations_of_a_file_replace_its_relative_uncertainty() -> None:
    """Of -Cm_alpha / CL_alpha the relative deviations add as squares: that of Cm_alpha as stated, 10 % of CL_alpha."""
    a = replace(navion(), relative_uncertainty=0.1, std={"Cm_alpha": 0.01})
    margin = cs.modes(a).numbers["static_margin"]
    assert margin.std == pytest.approx(margin.value * np.hypot(0.01 / a.derivatives["Cm_alpha"], 0.1), rel=1e-6)


def test_deviations_are_those_of_drawn_parameters() -> None:
    """150 aircraft drawn from the covariance (seed 1): their scatter is what is told, within 4 sigmas."""
    flight = SteadyFlight(parabolic())
    known = known_by_file(flight)
    rng, count = np.random.default_rng(1), 150
    drawn = rng.multivariate_normal(known.values, covariance(known), count)
    told = deviations(flight, known)
    found = [everything(flight, replace(known, values=values)) for values in drawn]
    for name, std in told.items():
        scatter = np.std([one[name] for one in found])
        # relative deviation of an estimated standard deviation: 1 / sqrt(2 N); the map is not quite linear
        assert abs(scatter / std - 1.0) < 4.0 / np.sqrt(2.0 * count) + 0.05, (name, scatter, std)


def test_an_estimate_gives_its_values_and_its_covariance() -> None:
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml")
    records = [record.between(0.0, 8.0) for record in cs.read_records([str(DEMO / "m1.csv")])]
    applied = flown_records(aircraft, records)
    fit = cs.solve(
        cs.Problem(applied.model, applied.records, free=["Cm_alpha", "Cm_q", "CL_alpha"]), solver=cs.GaussNewton()
    )
    found = cs.modes(aircraft, fit=fit)
    replaced = with_estimates(aircraft, fit.values, {})
    assert found.modes["short period"].eigenvalue == pytest.approx(cs.modes(replaced).modes["short period"].eigenvalue)
    flight = SteadyFlight(aircraft)
    by_fit = known_by_estimate(flight, fit.values, fit.covariance_corrected)
    by_file = known_by_document(flight, json.loads(json.dumps(fit.to_dict())), "estimate.json")
    assert by_file.values == pytest.approx(by_fit.values)
    # a file has the correlations of Cramer and Rao with the corrected deviations
    assert np.diag(covariance(by_file)) == pytest.approx(np.diag(covariance(by_fit)), rel=1e-9)
    with pytest.raises(cs.InputError, match="nothing like"):
        known_by_document(flight, {"parameters": 3}, "nothing like")
    with pytest.raises(cs.InputError, match="none of the estimates"):
        other = SteadyFlight(replace(boeing_747(), terms={}, derivatives={"CX_0": 0.0, "CZ_0": -0.6}))
        known_by_estimate(other, fit.values, fit.covariance_corrected)


def test_what_a_file_does_not_have_is_said() -> None:
    found = cs.modes(boeing_747())
    assert "dutch roll" not in found.modes and "lift_over_drag" not in found.numbers
    assert any("lateral" in note for note in found.notes) and any("glide" in note for note in found.notes)
    with pytest.raises(cs.InputError, match="trim"):
        cs.modes(replace(navion(), trim={}))
    with pytest.raises(cs.InputError, match="no steady flight"):
        cs.modes(
            replace(navion(), derivatives={**navion().derivatives, "Cm_alpha": 0.0, "Cm_delta_e": 0.0, "Cm_0": 0.3})
        )
    at = cs.modes(navion(), V=200.0 * FOOT, altitude=1000.0).flight
    assert at["V"] == 200.0 * FOOT and at["rho"] == pytest.approx(1.112, abs=1e-3)


@pytest.mark.slow
def test_a_diagnosis_gives_the_covariance_of_its_extended_aircraft() -> None:
    """Of the demonstration: smaller deviations than those of its prior, and the values of the extended file. The roll
    time constant is nearly inverse to Cl_p, and as well known as the flight tells that."""
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml")
    records = cs.read_records([str(DEMO / f"m{k}.csv") for k in (1, 2, 3, 4)])
    diagnosis = cs.diagnose(aircraft, records[:3], hold_out=records[3:])
    found = cs.modes(diagnosis.extended_aircraft, fit=diagnosis)
    stated = cs.modes(replace(diagnosis.extended_aircraft, std={}))
    for name, mode in found.modes.items():
        assert mode.eigenvalue == pytest.approx(stated.modes[name].eigenvalue)
    for name in ("short period", "dutch roll"):
        here, there = (one.modes[name].numbers["natural_frequency"].std for one in (found, stated))
        assert 0.0 < here < 0.5 * there
    roll, damping = found.modes["roll"].numbers["time_constant"], diagnosis.flight["Cl_p"]
    assert roll.std / roll.value == pytest.approx(abs(damping.std / damping.value), rel=0.3)


def test_a_point_at_which_the_file_does_not_hold_is_said() -> None:
    """A quarter of the speed takes sixteen times the lift coefficient: no derivative holds there."""
    fast = cs.modes(navion())
    assert not any("WARNING" in note for note in fast.notes)
    slow = cs.modes(navion(), V=0.5 * fast.flight["V"])
    assert any("angle of attack" in note and "WARNING" in note for note in slow.notes)
