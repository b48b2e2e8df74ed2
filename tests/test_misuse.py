"""What a user may give wrongly: every line of the table is one casid error, on one line, that says what to write.

Truth: the call itself, which is wrong, and the words without which its reader would not know what to do.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from estimation_cases import flight, short_period
from small_flight import aircraft_file, records

import casid as cs

T = np.arange(0.0, 8.0, 0.04)
U = 0.05 * np.sin(T)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Right things, to be used wrongly: a model and record, an aircraft and its flights, files of them."""
    folder = tmp_path_factory.mktemp("misuse")
    plane, flown = aircraft_file(), records()
    plane.write(folder / "plane.toml")
    cs.write_record(flown[0], folder / "m1.csv")
    model, record = short_period(), flight()
    fit = cs.solve(cs.Problem(model, [record], free=["M*"]))
    return SimpleNamespace(model=model, record=record, plane=plane, flown=flown, fit=fit, folder=folder)


def toy(**changes: Any) -> cs.Model:
    """A pendulum-like model with one thing changed."""
    given = {
        "states": ["x", "v"],
        "inputs": ["u"],
        "parameters": {"a": 1.0, "b": 2.0},
        "outputs": ["x"],
        "dynamics": lambda s: {"x": s.v, "v": -s.a * s.x + s.b * s.u},
        "output": lambda s: {"x": s.x},
    }
    return cs.define_model("toy", **(given | changes))


def pushed(**changes: np.ndarray) -> cs.Record:
    return cs.Record(name="m1", t=T, channels={"u": U, "x": U} | changes)


def problem(o: SimpleNamespace, **changes: Any) -> cs.Problem:
    return cs.Problem(o.model, [o.record], **({"free": ["M*"]} | changes))


def arrays(**changes: Any) -> cs.Record:
    return cs.Record.from_arrays("m1", T, {"delta_e": U, "alpha": U} | changes.pop("channels", {}), **changes)


def experiment(o: SimpleNamespace, **changes: Any) -> cs.Experiment:
    whole = {"surfaces": {"delta_e": 0.1}, "rest": {"delta_e": 0.0}, "start": [0.0, 0.0], "noise": {"q": 0.01}}
    return cs.Experiment(model=o.model, **(whole | {"duration": 8.0, "dt": 0.1, "parameters": ["M*"]} | changes))


def frame(**columns: Any) -> pd.DataFrame:
    return pd.DataFrame({"t": T, "delta_e": U, "alpha": U} | columns)


MISUSES: list[tuple[Callable[[SimpleNamespace], Any], str]] = [
    # records
    (lambda o: cs.read_record(frame()), "cs.Record.from_frame(df)"),
    (lambda o: cs.read_record(o.folder / "m1.csv", {"alpha": 3.5}), "expected NAME:unit or NUMBER:unit"),
    (lambda o: cs.read_record(o.folder / "m1.csv", 3), "expected a TOML file or a table"),
    (lambda o: cs.read_record(o.folder / "m1.cvs"), "did you mean '.csv'"),
    (lambda o: cs.read_records([]), "expected at least one file"),
    (lambda o: cs.read_records([o.record]), "expected file names"),
    (lambda o: cs.Record(name="m", t=None, channels={}), "t is None; expected numbers"),
    (lambda o: cs.Record(name="m", t=np.zeros((3, 2)), channels={}), "expected one dimension"),
    (lambda o: cs.Record(name="m", t=T[::-1], channels={}), "time must strictly increase"),
    (lambda o: cs.Record(name="m", t=["0", "1"], channels={}), "expected numbers"),
    (lambda o: cs.Record(name="m", t=T, channels=[U]), "expected a table like {'alpha': alpha}"),
    (lambda o: cs.Record(name="m", t=T, channels={"alpha": U[1:]}), "both need the same"),
    (lambda o: cs.Record(name="m", t=T, channels={"alpha": 5.0 * np.degrees(U), "delta_e": U}), "np.radians"),
    (lambda o: cs.flight_inputs(o.plane, o.flown[0].with_channels(alpha=np.full(200, 3.0))), "np.radians"),
    (lambda o: cs.Record(name=1, t=T, channels={}), "expected a text in quotes"),
    (lambda o: cs.Record(name="m", t=T, channels={"u": U}, hold="linaer"), "did you mean 'linear'"),
    (lambda o: o.record["alfa"], "did you mean 'alpha'"),
    (lambda o: arrays(channels={"alpha": np.degrees(U)}), "write the header as 'alpha [deg]'"),
    (lambda o: arrays(units={"alpha": "dge"}), "unknown unit 'dge'"),
    (lambda o: arrays(units={"alfa": "deg"}), "did you mean 'alpha'"),
    (lambda o: cs.Record.from_arrays("m1", T[:9], {"delta_e": U[:9]}), "too few to identify anything"),
    (lambda o: cs.Record.from_frame({"t": T}), "takes a pandas DataFrame"),
    (lambda o: cs.Record.from_frame(frame(alpha=["a"] * len(T))), "column 'alpha' is of str"),
    (lambda o: cs.Record.from_frame(frame().drop(columns="t")), "no column 't'"),
    (lambda o: cs.write_record(o.record, o.folder / "m1.txt"), "records are written as .csv"),
    # aircraft
    (lambda o: cs.Aircraft.read(o.folder / "plain.toml"), "plain.toml"),
    (lambda o: cs.aircraft_model(3), "expected a cs.Aircraft or the name of its file"),
    (lambda o: cs.aircraft_model(o.plane, axes="longitudnal"), "did you mean 'longitudinal'"),
    (lambda o: cs.aircraft_model(o.plane, outputs="q"), "write ['q']"),
    (lambda o: cs.aircraft_model(o.plane, outputs=["alfa"]), "did you mean 'alpha'"),
    (lambda o: cs.flight_inputs(o.plane, [o.flown[0]]), "expected a cs.Record or a file name"),
    (lambda o: cs.flight_inputs(o.plane, o.flown[0], "lat"), "did you mean 'lateral'"),
    (lambda o: cs.flight_inputs(o.plane, o.flown[0].without("delta_r")), "'delta_r' is missing"),
    (lambda o: cs.trim(o.plane, V="100", thrust=1e4), "expected a positive number"),
    # models
    (lambda o: toy(states="xv"), "expected a list of names"),
    (lambda o: toy(parameters=["a", "b"]), "expected a table like"),
    (lambda o: toy(parameters={"a": math.nan, "b": 1.0}), "'a' is nan; expected a finite number"),
    (lambda o: toy(inputs=["x"]), "one name is used twice"),
    (lambda o: toy(dynamics=lambda s: [s.v, s.x]), "returned a list of 2; expected a table by name"),
    (lambda o: toy(dynamics=lambda s: {"x": s.v, "v": s.aa * s.x}), "unknown symbol 'aa'; did you mean 'a'"),
    (lambda o: toy(dynamics=lambda s: {"x": s.v}), "returned no expression for v"),
    (lambda o: toy(dynamics=lambda s: {"x": s.v, "V": s.x, "v": s.x}), "unknown name in dynamics 'V'"),
    (lambda o: toy(dynamics=lambda s: {"x": math.sin(s.x), "v": s.x}), "np.sin(s.alpha)"),
    (lambda o: toy(dynamics=lambda s: {"x": "v", "v": s.x}), "'x' is the text 'v'; expected an expression"),
    (lambda o: toy(dynamics={"x": 0.0}), "expected a function of the symbols"),
    (lambda o: toy(dynamics=lambda s: {"x": o.model.x[0], "v": s.x}), "no symbol of this model"),
    (lambda o: toy(prior_std={"c": 1.0}), "unknown parameter 'c'"),
    (
        lambda o: cs.Problem(toy(guess=lambda r: r["x"]), pushed(), free=["a"]).model.guess(pushed()),
        "expected (200, 2)",
    ),
    # simulations
    (lambda o: cs.simulate(o.plane, o.record, [0.0, 0.0]), "write cs.aircraft_model(aircraft)"),
    (lambda o: cs.simulate(o.model, o.record, [0.0]), "expected 2 numbers: alpha, q"),
    (lambda o: cs.simulate(o.model, o.record, [0.0, math.nan]), "start of 'q' is nan"),
    (lambda o: cs.simulate(o.model, o.record, [0.0, 0.0], {"mq": 1.0}), "did you mean 'Mq'"),
    (lambda o: cs.simulate(o.model, o.record, [0.0, 0.0], substeps=0), "expected a whole number of at least 1"),
    (lambda o: cs.simulate(o.model, o.record, [0.0, 0.0], disturbances={"gust": U}), "unknown disturbance 'gust'"),
    (lambda o: cs.simulate(o.model, o.record.without("delta_e"), [0.0, 0.0]), "unknown channel 'delta_e'"),
    (
        lambda o: cs.simulate(toy(dynamics=lambda s: {"x": s.v, "v": -np.sqrt(s.x)}), pushed(), [0.1, -1.0]),
        "the derivative of 'v' is no number: sqrt(x) is nan where x = -",
    ),
    # problems
    (lambda o: cs.Problem(o.plane, o.flown, free=["Cm_*"]), "write cs.aircraft_model(aircraft)"),
    (lambda o: cs.Problem(cs.Model, [o.record], free=["M*"]), "model is the class Model"),
    (lambda o: cs.Problem(o.model, o.record["q"], free=["M*"]), "expected a cs.Record or a file name"),
    (lambda o: cs.Problem(o.model, [frame()], free=["M*"]), "cs.Record.from_frame(df)"),
    (lambda o: problem(o, free=[1]), "expected names in quotes"),
    (lambda o: problem(o, free="M*"), "write ['M*']"),
    (lambda o: problem(o, free=["Mz"]), "unknown parameter 'Mz'"),
    (lambda o: problem(o, start={"Mq": "a"}), "'Mq' is the text 'a'; expected a finite number"),
    (lambda o: problem(o, start={"Mq": math.nan}), "'Mq' is nan"),
    (lambda o: problem(o, fixed=["Mq"]), "expected a table like"),
    (lambda o: problem(o, cost="output"), "expected cs.OutputError()"),
    (lambda o: problem(o, cost=cs.OutputError), "write cost=OutputError()"),
    (lambda o: problem(o, cost=None), "expected cs.OutputError()"),
    (lambda o: problem(o, noise=0.1), "expected None, a table"),
    (lambda o: problem(o, noise="ful"), "did you mean 'full'"),
    (lambda o: problem(o, noise=np.eye(3)), "expected the covariance (2, 2)"),
    (lambda o: problem(o, prior="yes"), "True, False or a table"),
    (lambda o: problem(o, constraints="Mq < 0"), "cs.limit_parameter('Cm_q', upper=0.0)"),
    (lambda o: problem(o, constraints=[cs.limit_parameter("mq", upper=0.0)]), "did you mean 'Mq'"),
    (lambda o: problem(o, initial_state={"alpha": 0.0}), "cs.InitialState(value={...}"),
    (lambda o: problem(o, feedback=lambda x: x), "cs.SampledFeedback("),
    (lambda o: cs.limit_parameter("Mq"), "neither lower nor upper"),
    (lambda o: cs.limit_parameter("Mq", upper=math.nan), "upper is nan"),
    (lambda o: cs.limit_parameter(3, upper=0.0), "expected a text, like 'Cm_q'"),
    (lambda o: cs.limit_combination(["Mq"], upper=0.0), "expected a table like"),
    (lambda o: cs.limit_trajectory("alpha", lower=1.0, upper=0.0), "lower 1 is above upper 0"),
    # solving, and after it
    (lambda o: cs.solve(o.model), "cs.Problem(model, records, free=[...])"),
    (lambda o: cs.solve(problem(o), cs.MultipleShooting), "write MultipleShooting()"),
    (lambda o: cs.solve(problem(o), "single"), "write cs.MultipleShooting()"),
    (lambda o: cs.solve(problem(o), solver=cs.Ipopt), "write Ipopt()"),
    (lambda o: cs.MultipleShooting(interval=20.5), "expected a whole number"),
    (lambda o: cs.MultipleShooting(process_noise={"q": -1.0}), "expected a positive number"),
    (lambda o: cs.Collocation(degree=12), "expected 1 to 9"),
    (lambda o: o.fit["mq"], "did you mean 'Mq'"),
    (lambda o: cs.identifiability(problem(o)), "write cs.solve(problem)"),
    (lambda o: cs.profile(problem(o), ["Mq"]), "write cs.solve(problem)"),
    (lambda o: replace(problem(o), cost=cs.FilterError(process_noise={"w": 0.0})), "no disturbance"),
    (lambda o: cs.FilterError(process_noise=["w"]), "expected a table"),
    (lambda o: cs.FilterError(process_noise={"w": -1.0}), "a number from 0 on"),
    (lambda o: cs.profile(o.fit, "Mq"), "write ['Mq']"),
    (lambda o: cs.profile(o.fit, ["Mq"], level="high"), "level is the text 'high'"),
    (lambda o: cs.bootstrap(o.fit, 2.5, 0), "runs is 2.5; expected a whole number of at least 2"),
    (lambda o: cs.bootstrap(o.fit, 2, "a"), "seed is the text 'a'"),
    (lambda o: cs.bootstrap(o.fit, 2, 0, input_noise=0.1), "expected a table like {'delta_e': 0.001}"),
    (lambda o: o.fit.predict(o.record, window_s=-1.0), "window_s is -1; expected a positive number"),
    (lambda o: o.fit[3], "unknown parameter '3'"),
    (lambda o: o.fit.save(3), "expected a file name"),
    (lambda o: cs.Ipopt(hessian="exakt"), "did you mean 'exact'"),
    (lambda o: cs.GaussNewton(tolerance=-1.0), "GaussNewton: tolerance is -1; expected a positive number"),
    (lambda o: cs.Automatic(iterations=1.5), "Automatic: iterations is 1.5; expected a whole number"),
    (lambda o: cs.CombinedError(equation_weight="a"), "expected a finite number"),
    (lambda o: cs.InitialState(std=0.1), "expected a table like {'alpha': 0.01}"),
    (lambda o: cs.SampledFeedback(model=o.model, received=0.1), "an expression like model.u - 0.1 * model.x[1]"),
    # designs
    (lambda o: cs.design_input(o.model), "write cs.Experiment(model=..."),
    (
        lambda o: experiment(o, surfaces={"delta_e": "5 deg"}),
        "input 'delta_e' is the text '5 deg'; expected a positive",
    ),
    (lambda o: experiment(o, surfaces={"delta_a": 0.1}), "unknown input 'delta_a'; did you mean 'delta_e'"),
    (lambda o: experiment(o, start=[0.0]), "start has the shape (1,); expected a number each: alpha, q"),
    (lambda o: experiment(o, rest=0.0), "Experiment: rest is 0.0; expected a table"),
    (lambda o: experiment(o, parameters="M*"), "write ['M*']"),
    (lambda o: experiment(o, duration="8 s"), "duration is the text '8 s'"),
    (lambda o: cs.design_input(experiment(o), "steps"), "write cs.StepInput(pulses=4)"),
    (lambda o: cs.design_input(experiment(o), criterion="E"), "criterion is the text 'E'; expected 'D' or 'A'"),
    (lambda o: cs.StepInput(pulses="four"), "pulses is the text 'four'"),
    # other verbs
    (lambda o: cs.table(3, "alpha", [0.0, 1.0], [0.0, 1.0]), "table: coefficient is 3"),
    (lambda o: cs.trim(o.plane, V=100.0, altitude=1e6), "expected -1000 to 20000 m"),
    (lambda o: cs.check("m7.csv"), "m7.csv: no such file"),
    (lambda o: cs.check(o.flown, 3), "expected a cs.Aircraft or the name of its file"),
    (lambda o: cs.write_report(o.fit, o.folder), "write cs.diagnose(aircraft, records)"),
    (lambda o: cs.Library(regressors={"x^3": 3}), "regressor 'x^3' is 3; expected a function"),
    (lambda o: o.record.between(50.0, 60.0), "no sample from 50 to 60 s; it has 0 to"),
    (lambda o: cs.write_record(o.record, 3), "expected a file name"),
    # diagnoses
    (lambda o: cs.diagnose("plane", o.flown), "plane"),
    (lambda o: cs.diagnose(o.folder / "plane.toml", 3), "expected a list of cs.Record or of file names"),
    (lambda o: cs.diagnose(o.plane, o.folder / "m2.csv"), "m2.csv: no such file"),
    (lambda o: cs.diagnose(o.plane, o.flown, hold_out=[1]), "expected a cs.Record or a file name"),
    (lambda o: cs.diagnose(o.model, o.flown, as_recorded=True), "a Model takes ports, exact and library"),
    (lambda o: cs.diagnose(o.model, o.flown, axes="full"), "a Model takes ports, exact and library"),
    (lambda o: cs.diagnose(o.model, o.flown, exact=3), "exact is 3"),
    (lambda o: cs.diagnose(o.model, o.flown, library=3), "library is 3; write cs.Library(...)"),
    (lambda o: cs.diagnose(o.model, o.flown, criteria=3), "criteria is 3; write cs.Criteria(...)"),
    (lambda o: cs.diagnose(o.model, o.flown, ports=["q"]), "is the text 'q'; write cs.ModelPort("),
    (lambda o: cs.diagnose(o.plane, o.flown, as_recorded="yes"), "as_recorded is the text 'yes'"),
    (lambda o: cs.diagnose(o.flown[0], o.plane), "expected a cs.Aircraft or the name of its file"),
]


def test_there_are_enough() -> None:
    assert len(MISUSES) >= 65


@pytest.mark.parametrize("number", range(len(MISUSES)))
def test_a_misuse_is_one_line_that_says_what_to_write(number: int, here: SimpleNamespace) -> None:
    call, words = MISUSES[number]
    with pytest.raises(cs.CasidError) as caught:
        call(here)
    text = str(caught.value)
    assert words in text
    assert "\n" not in text and len(text) < 400


def test_what_users_have_is_taken(here: SimpleNamespace) -> None:
    """A path for an aircraft or record, one record for a list, a table for a column map, one constraint."""
    plane, csv = here.folder / "plane.toml", here.folder / "m1.csv"
    ready = cs.flight_inputs(str(plane), csv)
    assert cs.aircraft_model(plane).name == here.plane.name
    only = cs.Problem(here.model, here.record, free=["Mq"], constraints=cs.limit_parameter("Mq", upper=0.0))
    assert only.records == (here.record,) and len(only.constraints) == 1
    assert [r.name for r in cs.Problem(cs.aircraft_model(plane), ready, free=["Cm_q"]).records] == ["m1"]
    mapped = cs.read_record(csv, {"alpha": "alpha:rad*2"})
    np.testing.assert_array_equal(mapped["alpha"], 2.0 * ready["alpha"])


def test_functions_of_numpy_take_symbols_without_a_word() -> None:
    """Warnings are errors here. Truth: the same model written with casadi."""
    model = toy(dynamics=lambda s: {"x": s.v, "v": -s.a * np.sin(s.x) + s.b * s.u})
    flown = cs.simulate(model, pushed(), [0.1, 0.0])
    assert flown.state("x")[1] == pytest.approx(0.1 - 0.5 * 0.04**2 * math.sin(0.1), rel=1e-4)


def test_a_data_frame_of_any_system_is_a_record(tmp_path: Path) -> None:
    """Few samples, no control surface, names that mean something else of an aircraft: the numbers as they are."""
    pendulum = pd.DataFrame({"t": T[:9], "angle": U[:9], "v": T[:9], "torque [N]": U[:9]})
    record = cs.Record.from_frame(pendulum, name="swing", hold="held")
    assert list(record.channels) == ["angle", "v", "torque"] and len(record) == 9 and not record.notes
    np.testing.assert_array_equal(record["angle"], U[:9])
    again = cs.Record.from_arrays("swing", T[:9], {"V": U[:9], "torque": U[:9]})
    np.testing.assert_array_equal(again["V"], U[:9])
    assert "system other than an aircraft, with V of its own" in again.notes[0]


def test_a_record_of_memory_is_that_of_a_file(tmp_path: Path) -> None:
    """Arrays, a data frame with units in its columns or beside them, and the CSV of both: the same record."""
    degrees = np.degrees(U)
    (tmp_path / "m1.csv").write_text(
        "t,delta_e [deg],alpha [deg]\n"
        + "".join(f"{t!r},{v!r},{v!r}\n" for t, v in zip(T.tolist(), degrees.tolist(), strict=True))
    )
    file = cs.read_record(tmp_path / "m1.csv")
    units = {"delta_e": "deg", "alpha": "deg"}
    for record in (
        cs.Record.from_arrays("m1", T, {"delta_e": degrees, "alpha": degrees}, units=units),
        cs.Record.from_frame(frame(delta_e=degrees, alpha=degrees), name="m1", units=units),
        cs.Record.from_frame(pd.read_csv(tmp_path / "m1.csv").set_index("t"), name="m1"),
    ):
        np.testing.assert_array_equal(record.t, file.t)
        assert list(record.channels) == list(file.channels) and record.notes == file.notes
        for name in file.channels:
            np.testing.assert_array_equal(record[name], file[name])
