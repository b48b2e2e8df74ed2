"""Constructors in Python keep the contract of files: a value of the wrong type is an InputError of one line.

Truth: the language. No field of these classes may be every one of the values that are tried."""

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
MAKERS: dict[str, Any] = {
    "Aircraft": aircraft_file(),
    "Inertia": aircraft_file().inertia,
    "EffectValue": cs.EffectValue(
        kind="aero_term", target="Cm", term="alpha^2", value=0.1, onset_s={"m1": (1.0, 2.0)}, parameters={"a": 1.0}
    ),
    "Grid": Grid(breakpoints=((0.0, 1.0),), values=(0.0, 1.0)),
    "Table": cs.table("Cm", "alpha", [0.0, 1.0], [0.0, 1.0]),
    "Record": cs.Record(name="m1", t=np.arange(4.0), channels={"alpha": np.zeros(4)}, events={"dose": [1.0]}),
}


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
