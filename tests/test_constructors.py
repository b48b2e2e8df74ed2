"""Constructors in Python keep the contract of files: a value of the wrong type is an InputError of one line.

Truth: the language. No field of these classes may be every one of the values that are tried. They are the classes that
a user makes; results, such as `Fit` or `Bootstrap`, are made by casid alone and take what it gives them."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from small_flight import aircraft_file

import casid as cs
from casid.model.tables import Grid

WRONG: list[Any] = [
    None,
    True,
    3,
    -1.5,
    float("nan"),
    10**400,
    1j,
    "",
    "x",
    "a\nb",
    b"x",
    [],
    [[]],
    ["x"],
    [None],
    (1.0, "x"),
    {},
    {"x": 1.0},
    {"Cm": 3},
    {"Cm": {"alpha^2": "x"}},
    {3: 4},
    {"V": []},
    set(),
    object(),
    int,
    len,
    np.array(3.0),
    np.zeros((2, 2)),
    np.array(["x"]),
    range(3),
]
LAG = cs.define_model(
    "lag",
    states=["x"],
    inputs=["u"],
    parameters={"T": 0.5},
    outputs=["y"],
    disturbances=["w"],
    dynamics=lambda s: {"x": (s.u - s.x) / s.T + s.w},
    output=lambda s: {"y": s.x},
    events=lambda s: {"kick": {"x": s.x + 1.0}},
)
FLIGHT = cs.Record(name="m1", t=0.1 * np.arange(40.0), channels={"u": np.ones(40), "y": np.arange(40.0)})
ROTOR = cs.Rotor(name="m1", position=(0.1, 0.1, 0.0), spin=1, thrust=(0.0, 0.0, 2e-8), torque=0.006)
FREQUENCIES = np.arange(1.0, 9.0)
MAKERS: dict[str, Any] = {
    "Model": LAG,
    "ModelPort": cs.ModelPort(kind="input", name="u", unit="V", matters=0.1),
    "SampledFeedback": cs.SampledFeedback(model=LAG, received=LAG.u - 0.5 * LAG.x),
    "Library": cs.Library(),
    "Rotor": ROTOR,
    "Rotors": cs.Rotors(each=(ROTOR,), voltage=cs.Voltage(reference=4.0)),
    "Voltage": cs.Voltage(reference=4.0),
    "Problem": cs.Problem(LAG, [FLIGHT], free=["T"]),
    "InitialState": cs.InitialState(value={"x": 0.0}, std={"x": 1.0}),
    "Noise": cs.Noise(sigma=0.1),
    "StudentT": cs.StudentT(),
    "Huber": cs.Huber(),
    "RangeWeights": cs.RangeWeights(),
    "CombinedError": cs.CombinedError(),
    "FilterError": cs.FilterError(process_noise={"w": 0.0}),
    "FourierEquationError": cs.FourierEquationError(band=(0.1, 2.0)),
    "FourierOutputError": cs.FourierOutputError(band=(0.1, 2.0)),
    "SingleShooting": cs.SingleShooting(),
    "MultipleShooting": cs.MultipleShooting(),
    "Collocation": cs.Collocation(),
    "Automatic": cs.Automatic(),
    "GaussNewton": cs.GaussNewton(),
    "Ipopt": cs.Ipopt(),
    "Experiment": cs.Experiment(
        model=LAG,
        surfaces={"u": 0.1},
        rest={"u": 0.0},
        start=np.zeros(1),
        noise={"y": 0.01},
        duration=8.0,
        dt=0.1,
        parameters=["T"],
    ),
    "StepInput": cs.StepInput(),
    "Multisine": cs.Multisine(),
    "MeasuredResponse": cs.MeasuredResponse(input="u", output="y", omega=FREQUENCIES, response=FREQUENCIES + 1j),
    "MismatchEnvelope": cs.MismatchEnvelope(
        omega=FREQUENCIES,
        gain_low_db=-FREQUENCIES,
        gain_high_db=FREQUENCIES,
        phase_low_deg=-FREQUENCIES,
        phase_high_deg=FREQUENCIES,
    ),
    "TransferFunction": cs.TransferFunction(gain="K", poles=["a"]),
    "ColumnMap": cs.ColumnMap(),
    "Aircraft": aircraft_file(),
    "Inertia": aircraft_file().inertia,
    "EffectValue": cs.EffectValue(
        kind="aero_term", target="Cm", term="alpha^2", value=0.1, onset_s={"m1": (1.0, 2.0)}, parameters={"a": 1.0}
    ),
    "Grid": Grid(breakpoints=((0.0, 1.0),), values=(0.0, 1.0)),
    "Table": cs.table("Cm", "alpha", [0.0, 1.0], [0.0, 1.0]),
    "Section": cs.Section(title="Loading", parts=["Weighed.", {"what": ["fuel"], "kg": [2100.0]}], name="loading"),
    "Record": cs.Record(name="m1", t=np.arange(4.0), channels={"alpha": np.zeros(4)}, events={"dose": [1.0]}),
}


def test_every_class_that_a_user_makes_is_tried() -> None:
    """Of the exported classes, those that check their fields; `Bootstrap` checks what the program gave it."""
    checked = {name for name in cs.__all__ if hasattr(getattr(cs, name), "__post_init__")}
    assert checked - {"Bootstrap"} == {name for name in MAKERS if name in cs.__all__}


@pytest.mark.parametrize("name", MAKERS)
def test_a_wrong_value_is_one_line(name: str) -> None:
    sound = MAKERS[name]
    given = {one.name: getattr(sound, one.name) for one in fields(sound) if one.init}
    assert type(sound)(**given) is not None
    outcomes: Counter[str] = Counter()
    for field in given:
        for value in WRONG:
            try:
                made = type(sound)(**(given | {field: value}))
                repr(made)
                outcomes["made"] += 1
            except cs.CasidError as error:
                assert str(error).isprintable() and len(str(error)) < 600, (field, value)
                outcomes["refused"] += 1
            except Exception as error:
                pytest.fail(f"{name}({field}={value!r:.60}): {type(error).__name__}: {error}")
    assert outcomes["refused"] > 2 * outcomes["made"], outcomes


def test_table_takes_what_a_file_takes() -> None:
    for position, sound in enumerate(("Cm", "alpha", [0.0, 1.0], [0.0, 1.0])):
        for value in WRONG:
            arguments: list[Any] = ["Cm", "alpha", [0.0, 1.0], [0.0, 1.0]]
            arguments[position] = value
            try:
                cs.table(*arguments)
            except cs.CasidError as error:
                assert str(error).isprintable() and len(str(error)) < 600, (sound, value)
