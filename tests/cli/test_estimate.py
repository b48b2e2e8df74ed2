"""Truth: simulated flights of the Do 328 with known derivatives; published and independent values on real records."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from pkgutil import resolve_name

import casadi as ca
import numpy as np
import pytest

from casid.cli.app import COMMANDS
from casid.cli.run import call, script
from casid.errors import InputError
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.dynamics import aircraft_model
from casid.model.flown_records import flown_records
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.readers import read_record, write_record
from casid.records.record import Record
from problems.do328 import STABLE, do328
from problems.real import hfb320, hfb320_aircraft

LEVEL = trim(do328(), V=144.0, thrust=10e3)
NOISE = {"V": 0.1, "alpha": 5e-4, "theta": 5e-4, "q": 5e-4, "ax": 0.02, "az": 0.05, "qdot": 2e-3}
PITCH = tuple(name for name in STABLE if name[:2] in ("CL", "CD", "Cm"))


def flown(seed: int, aircraft: Aircraft | None = None) -> Record:
    """Longitudinal flight about the trim: elevator 3-2-1-1, 8 s at 25 Hz, white noise on every channel."""
    aircraft, rng = aircraft or do328(), np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 0.04)
    channels = {
        name: np.full(len(t), value) for name, value in LEVEL.inputs.items() if name not in ("delta_a", "delta_r")
    }
    pulse = np.select([t < 1.0, t < 2.8, t < 4.0, t < 4.6, t < 5.2], [0.0, 0.04, -0.04, 0.04, -0.04], 0.0)
    channels["delta_e"] = channels["delta_e"] + pulse
    record = Record(name=f"m{seed}", t=t, channels={**channels, "V": np.full(len(t), 144.0)})
    applied = flown_records(aircraft, [record], outputs=tuple(NOISE))
    state = {"u": LEVEL.state[0], "w": LEVEL.state[2], "q": 0.0, "theta": LEVEL.theta}
    clean = simulate(applied.model, applied.records[0], np.array([state[s] for s in applied.model.states]))
    noisy = {n: clean.output(n) + s * rng.standard_normal(len(t)) for n, s in NOISE.items()}
    return record.with_channels(**noisy)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two records and an aircraft file whose derivatives are 0.8 times the true ones."""
    place = tmp_path_factory.mktemp("flight")
    for seed in (1, 2):
        write_record(flown(seed), place / f"m{seed}.csv")
    do328({name: 0.8 * value for name, value in STABLE.items()}).write(place / "guess.toml")
    do328().write(place / "truth.toml")
    return place


@pytest.fixture
def run_in_process(load_script, monkeypatch, capsys):
    """Run a script here and return what it printed: quicker than a process, errors come as exceptions."""

    def run(name: str, *arguments: object) -> str:
        words = [str(argument) for argument in arguments]
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
        if name in ("estimate", "simulate"):  # scripts of one command
            call(script(resolve_name(COMMANDS[name])), words)
        else:
            load_script(name).main()
        return capsys.readouterr().out

    return run


def estimated(out: Path) -> dict:
    return json.loads((out / "estimate.json").read_text())


@pytest.fixture
def pitching_moment(folder, run_in_process):
    """Estimate the derivatives of Cm from one record, starting at the truth; returns estimate.json."""

    def run(out: Path, *options: str) -> dict:
        always = ("--aircraft", folder / "truth.toml", "--free", "Cm_*", "--out", out)
        run_in_process("estimate", folder / "m1.csv", *always, *options)
        return estimated(out)

    return run


def test_estimates_come_with_their_errors_and_a_model_that_reads_back(folder, script_here, tmp_path):
    status, _, error = script_here(
        "estimate", folder / "m?.csv", "--aircraft", folder / "guess.toml", "--out", tmp_path
    )
    assert status == 0, error
    result = estimated(tmp_path)
    assert result["verdict"] == "usable" and result["next"][0]["command"].startswith("casid simulate")
    assert result["converged"] and result["axes"] == "longitudinal" and result["records"] == ["m1", "m2"]
    assert set(result["parameters"]) == set(PITCH)
    error = np.array([result["parameters"][n]["value"] - STABLE[n] for n in result["correlation"]["names"]])
    std = np.array([result["parameters"][n]["std"] for n in result["correlation"]["names"]])
    covariance = np.array(result["correlation"]["matrix"]) * std[:, None] * std
    assert error @ np.linalg.solve(covariance, error) < 29.6  # chi-square, 10 degrees of freedom, 0.999
    for name, parameter in result["parameters"].items():
        assert parameter["prior"] == pytest.approx(0.8 * STABLE[name])
        assert 0.0 < parameter["std_cramer_rao"] <= parameter["std"] * (1.0 + 1e-12)  # equal where residuals are white
    for name, sigma in NOISE.items():
        assert result["channels"][name]["rms"] == pytest.approx(sigma, rel=0.2)
    written = Aircraft.read(tmp_path / "model.toml")
    for name in PITCH:
        assert written.derivatives[name] == result["parameters"][name]["value"]
    assert written.derivatives["Cl_p"] == 0.8 * STABLE["Cl_p"]
    assert {p.name for p in (tmp_path / "figures").iterdir()} >= {"correlations.svg", "histories_m1.svg"}
    assert json.loads((tmp_path / "run.json").read_text())["command"][0] == "estimate.py"


def test_coefficients_that_are_left_out_are_said(folder, tmp_path, capsys):
    """Aileron and rudder are not in these records: the lateral coefficients of the file are named, and no other."""
    words = [str(folder / "m1.csv"), "--aircraft", str(folder / "truth.toml"), "--free", "Cm_0", "--out", str(tmp_path)]
    call(script(resolve_name(COMMANDS["estimate"])), words)
    (said,) = [line for line in capsys.readouterr().err.splitlines() if "estimated" in line]
    assert all(name in said for name in ("delta_a", "delta_r", "CY", "Cl", "Cn"))
    assert not any(name in said for name in ("CL", "CD", "Cm", "delta_e"))
    call(script(resolve_name(COMMANDS["estimate"])), [*words, "--axes", "longitudinal"])
    assert "Cn" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [
        ("--method", "single"),
        ("--method", "multiple", "--interval", "10"),
        ("--method", "collocation"),
        ("--solver", "ipopt"),
        ("--cost", "equation"),
        ("--cost", "combined", "--equation-weight", "0.3"),
    ],
    ids=" ".join,
)
def test_every_choice_finds_the_pitching_moment(pitching_moment, tmp_path, options):
    """Cm_alpha, Cm_q and Cm_delta_e within a few per cent; equation error is biased by noise in its regressors."""
    result = pitching_moment(tmp_path, *options)
    assert result["converged"], result["status"]
    for name in ("Cm_alpha", "Cm_q", "Cm_delta_e"):
        assert result["parameters"][name]["value"] == pytest.approx(STABLE[name], rel=0.05), name


def test_methods_agree_on_the_optimum(pitching_moment, tmp_path):
    """Single and multiple shooting minimise the same sum of squares."""
    single, multiple = (
        pitching_moment(tmp_path / method, "--method", method)["parameters"] for method in ("single", "multiple")
    )
    for name, one in single.items():
        assert abs(one["value"] - multiple[name]["value"]) < 1e-3 * one["std"]


def test_filter_error_estimates_the_noise_of_forces(pitching_moment, tmp_path):
    """A flight without process noise: what is found of it is too small to move the estimates."""
    result = pitching_moment(tmp_path, "--cost", "filter")
    assert result["converged"], result["status"]
    assert set(result["process_noise"]) == {"dCL", "dCD", "dCm"}
    # an accelerometer cannot tell its own noise from that of the force
    for name, sigma in NOISE.items():
        if name in ("ax", "az"):
            continue
        assert result["noise"][name] == pytest.approx(sigma, rel=0.25), name
    for name in ("Cm_alpha", "Cm_q", "Cm_delta_e"):
        parameter = result["parameters"][name]
        assert abs(parameter["value"] - STABLE[name]) < 4.0 * parameter["std"], name


def test_a_lag_that_was_found_is_estimated_again_by_its_name(run_in_process, tmp_path):
    """The elevator of the flight lags by 0.15 s; the file says 0.05 s. Truth: the simulator's lag."""
    lag = EffectValue(kind="actuator_lag", target="delta_e", value=0.15)
    record = flown(4, do328().with_effects([lag]))
    write_record(record, tmp_path / "m1.csv")
    do328().with_effects([EffectValue(kind="actuator_lag", target="delta_e", value=0.05)]).write(tmp_path / "file.toml")
    options = ("--aircraft", tmp_path / "file.toml", "--free", "actuator_lag(delta_e)", "--out", tmp_path / "out")
    run_in_process("estimate", tmp_path / "m1.csv", *options)
    found = estimated(tmp_path / "out")["parameters"]["actuator_lag(delta_e)"]
    assert abs(found["value"] - 0.15) < 4.0 * found["std"] + 0.003 and found["std"] < 0.01


def test_effects_of_the_file_act_and_can_be_freed(run_in_process, tmp_path):
    """A c.g. 0.1 m forward, guessed as 0.03 m; instrument biases have an own value per record."""
    truth = do328().with_effects([EffectValue(kind="cg_offset", target="x", value=0.1)])
    for seed in (3, 4):
        record = flown(seed, truth)
        write_record(record.with_channels(q=record["q"] + 0.01 * (seed == 4)), tmp_path / f"m{seed}.csv")
    do328().with_effects([EffectValue(kind="cg_offset", target="x", value=0.03)]).write(tmp_path / "file.toml")
    options = ("--aircraft", tmp_path / "file.toml", "--free", "cg_offset(x)", "bias_q", "--out", tmp_path / "out")
    run_in_process("estimate", tmp_path / "m*.csv", *options)
    result = estimated(tmp_path / "out")
    for name, value in {"cg_offset(x)": 0.1, "bias_q[m3]": 0.0, "bias_q[m4]": 0.01}.items():
        parameter = result["parameters"][name]
        assert abs(parameter["value"] - value) < 4.0 * parameter["std"], name
    effect = Aircraft.read(tmp_path / "out" / "model.toml").effects[0]
    assert effect.value == result["parameters"]["cg_offset(x)"]["value"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--free", "Cm_alfa"), "did you mean"),
        (("--equation-weight", "0.5"), "needs --cost combined"),
        (("--cost", "combined", "--equation-weight", "1.5"), "inside"),
        (("--interval", "0"), "at least 1"),
        (("--interval", "5", "--method", "single"), "needs --method multiple"),
        (("--cost", "filter", "--interval", "5"), "leave --method and --interval out"),
        (("--axes", "full"), "delta_a"),
        (("--cost", "outptu"), 'Invalid value "outptu"'),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_options_are_one_line(folder, run_in_process, tmp_path, options, message):
    always = ("--aircraft", folder / "guess.toml", "--out", tmp_path / "x")
    with pytest.raises(InputError, match=message):
        run_in_process("estimate", folder / "m1.csv", *always, *options)
    assert not (tmp_path / "x").exists()


def test_bad_input_ends_with_status_2(folder, script_here, tmp_path):
    where = ("--aircraft", folder / "guess.toml", "--out", tmp_path)
    status, _, error = script_here("estimate", folder / "m9.csv", *where)
    assert status == 2 and len(error.strip().splitlines()) == 1 and "m9.csv" in error
    status, _, error = script_here("simulate", folder / "m1.csv", "--aircraft", folder / "m1.csv", "--out", tmp_path)
    assert status == 2 and len(error.strip().splitlines()) == 1


def test_equations_refuse_effects_that_they_cannot_have(folder, run_in_process, tmp_path):
    do328().with_effects([EffectValue(kind="sensor_scale", target="alpha", value=0.1)]).write(tmp_path / "scaled.toml")
    with pytest.raises(InputError, match=r"sensor_scale\(alpha\).*use OutputError"):
        run_in_process(
            "estimate",
            folder / "m1.csv",
            "--aircraft",
            tmp_path / "scaled.toml",
            "--cost",
            "equation",
            "--out",
            tmp_path / "out",
        )


def test_simulate_flies_aircraft_side_by_side(folder, script_here, tmp_path):
    """The true aircraft leaves the noise, the wrong one more; what is written reads back as a record."""
    status, said, error = script_here(
        "simulate",
        folder / "m1.csv",
        folder / "m2.csv",
        "--aircraft",
        folder / "truth.toml",
        folder / "guess.toml",
        "--out",
        tmp_path,
    )
    assert status == 0, error
    result = json.loads((tmp_path / "simulate.json").read_text())["records"]
    assert set(result) == {"m1", "m2"}
    for record in result.values():
        for channel, sigma in NOISE.items():
            assert record["truth"][channel]["rms"] == pytest.approx(sigma, rel=0.3), channel
        assert record["guess"]["q"]["rms"] > 3.0 * NOISE["q"]
    written = read_record(tmp_path / "m1__truth.csv")
    clean = aircraft_model(do328(), axes="longitudinal").outputs
    assert set(clean) <= set(written.channels)
    np.testing.assert_array_equal(written["delta_e"], read_record(folder / "m1.csv")["delta_e"])
    assert (tmp_path / "figures" / "histories_m1.svg").is_file() and "m2: measured less simulated" in said
    worst = min((one["R2"], name) for row in result.values() for name, one in row["guess"].items())
    first = said.splitlines()[0]
    assert first.startswith("guess: ") and f"R2 {worst[0]:.3g}" in first and worst[1] in first
    part = said.split("m2: measured less")[1].splitlines()
    row = next(line.split() for line in part if line.startswith("q [deg/s]"))
    of = [result["m2"][a]["q"] for a in ("truth", "guess")]
    told = [*(np.degrees(one["rms"]) for one in of), *(one["R2"] for one in of)]
    assert [float(x) for x in row[2:]] == pytest.approx(told, rel=1e-3)


def test_a_simulation_that_diverges_is_said(folder, run_in_process, tmp_path):
    do328({**STABLE, "Cm_alpha": 60.0, "Cm_q": 200.0}).write(tmp_path / "wild.toml")
    out = run_in_process("simulate", folder / "m1.csv", "--aircraft", tmp_path / "wild.toml", "--out", tmp_path / "out")
    assert "diverged" in out
    assert "diverged" in json.loads((tmp_path / "out" / "simulate.json").read_text())["records"]["m1"]["wild"]


# -- real flight -------------------------------------------------------------------------------------------------------


def test_hfb320_as_an_aircraft_file_is_the_published_model():
    """Thrust off, at the speed V0 that the published model makes q dimensionless with: the same accelerations."""
    published, V, alpha, theta, q, delta_e = hfb320.model(), 104.67, 0.08, 0.05, 0.03, -0.02
    given = published.nominal_vector(hfb320.PUBLISHED)
    f = ca.Function("f", [published.x, published.u, published.p, published.w], [published.f])
    Vdot, alphadot, _, qdot = f([V, alpha, theta, q], [delta_e, 0.0], given, [0.0, 0.0]).full()[:, 0]
    model = aircraft_model(hfb320_aircraft.aircraft(), axes="longitudinal")
    known = {"delta_e": delta_e, "rho": 0.792}
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    state = [V * np.cos(alpha), V * np.sin(alpha), q, theta]
    u = [known.get(name, 0.0) for name in model.inputs]
    udot, wdot, found, _ = f(state, u, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0]
    assert np.cos(alpha) * udot + np.sin(alpha) * wdot == pytest.approx(Vdot, rel=1e-9)
    assert (np.cos(alpha) * wdot - np.sin(alpha) * udot) / V == pytest.approx(alphadot, rel=1e-9)
    assert found == pytest.approx(qdot, rel=1e-9)


@pytest.mark.slow
def test_hfb320_script(flight_data, run_in_process, tmp_path):
    """Published output error within one standard error; turbulence; the gain of process noise on unseen data."""
    run_in_process("hfb320", flight_data, "--out", tmp_path)
    result = json.loads((tmp_path / "hfb320.json").read_text())
    for name, value in hfb320.PUBLISHED.items():
        parameter = result["output_error"]["parameters"][name]
        assert abs(parameter["value"] - value) < parameter["std"], name
    assert all(test["whiteness_p"] < 1e-6 for test in result["residuals"].values())
    assert result["air"]["named"] and 0.1 < result["air"]["sigma"] < 2.0
    assert 4.3 < result["filter_error"]["parameters"]["CL_alpha"]["value"] < 4.5
    before, after = (result["held_out"][label] for label in ("output error", "with process noise"))
    assert after["log_likelihood_per_sample"] > before["log_likelihood_per_sample"] + 1.0
    for channel, rms in after["one_step_rms"].items():
        assert rms < before["one_step_rms"][channel], channel
