"""Comparisons of diagnoses and of flights. Truth: symmetry, identity, and a change that was put into one flight."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_flight import aircraft_file, records

from casid.acceptance.compared import compare_diagnoses
from casid.acceptance.fleet import compare_flights
from casid.cli.compare import compare
from casid.errors import InputError
from casid.records.record import Record

STEPS = {"as_given": 10.0, "data_mended": 10.0, "values": 3.0, "structure": 1.1, "noise": 1.0}
DOCUMENT: dict[str, Any] = {
    "schema": "casid.diagnosis/4",
    "verdict": "explained",
    "budget": {"records": ["m4"], "channels": {"q": STEPS, "theta": STEPS}, "all": STEPS},
    "records": [{"record": "m1", "as_given": 9.0, "left": 1.0}],
    "causes": [{"name": "mass", "value": 0.1, "std": 0.01, "unit": "1", "probability": 0.9}],
    "parameters": {"Cm_q": {"a_priori": -10.0, "flight": {"value": -12.0, "std": 0.1}}},
}


def written(folder: Path, name: str, document: dict[str, Any]) -> Path:
    (folder / name).mkdir(exist_ok=True)
    (folder / name / "diagnosis.json").write_text(json.dumps(document), encoding="utf-8")
    return folder / name


def changed(factor: float, value: float, causes: bool = True) -> dict[str, Any]:
    """Return the document with errors times a factor, another value by the records, and with or without its cause."""
    other = copy.deepcopy(DOCUMENT)
    steps = {name: factor * size for name, size in STEPS.items()}
    other["budget"] |= {"channels": {"q": steps, "theta": STEPS}, "all": steps}
    other["parameters"]["Cm_q"]["flight"]["value"] = value
    return other if causes else other | {"causes": []}


def test_a_diagnosis_is_as_good_as_itself(tmp_path: Path) -> None:
    one = written(tmp_path, "one", DOCUMENT)
    found = compare_diagnoses(one, written(tmp_path, "two", DOCUMENT))
    assert not found.worse and not any(value.differs for value in found.values)
    assert found.points == () and all(one.as_given[0] == one.as_given[1] for one in found.channels)
    assert all(
        given == given_again and left == left_again for _, given, given_again, left, left_again in found.rows().rows
    )
    assert len(compare_diagnoses(one, one).rows().rows) == 1 + len(found.channels)


@given(factor=st.floats(0.2, 5.0), value=st.floats(-20.0, -5.0), causes=st.booleans())
@settings(max_examples=30, deadline=None)
def test_the_sides_are_exchanged_with_the_folders(
    factor: float, value: float, causes: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = tmp_path_factory.mktemp("both")
    one, two = written(place, "one", DOCUMENT), written(place, "two", changed(factor, value, causes))
    there, back = compare_diagnoses(one, two), compare_diagnoses(two, one)
    assert there.together.as_given == back.together.as_given[::-1]
    assert {c.name: c.sizes for c in there.causes} == {c.name: c.sizes[::-1] for c in back.causes}
    (of,), (again,) = there.values, back.values
    assert of.flight == again.flight[::-1] and of.sigmas == pytest.approx(abs(value + 12.0) / math.hypot(0.1, 0.1))
    assert there.worse == (factor > 1.1)
    assert not (there.worse and back.worse) or not causes


def test_a_new_cause_is_worse_and_one_that_is_gone_is_not(tmp_path: Path) -> None:
    one, two = written(tmp_path, "one", DOCUMENT), written(tmp_path, "two", changed(1.0, -12.0, causes=False))
    assert not compare_diagnoses(one, two).worse and compare_diagnoses(two, one).worse
    assert (compare(str(one), str(two)), compare(str(two), str(one))) == (0, 1)


@pytest.mark.parametrize("lost", [key for key in DOCUMENT if key not in ("records",)])
@pytest.mark.parametrize("value", [None, 3, "text", [], [None]])
def test_what_is_no_whole_diagnosis_is_refused_in_a_line(tmp_path: Path, lost: str, value: object) -> None:
    """Whatever stands in the place of a part, there is a comparison or an InputError, and nothing else."""
    good = written(tmp_path, "good", DOCUMENT)
    for name, broken in (("gone", {k: v for k, v in DOCUMENT.items() if k != lost}), ("odd", DOCUMENT | {lost: value})):
        bad = written(tmp_path, name, broken)
        for pair in ((good, bad), (bad, good)):
            try:
                str(compare_diagnoses(*pair))
            except InputError as error:
                assert str(bad) in str(error)


def flights(factor: float) -> list[Record]:
    """Return three flights; in the last, each degree of the elevator is recorded as `factor` degrees."""
    first, second = records()
    steady = np.median(second["delta_e"])
    more = second.with_channels(delta_e=steady + factor * (second["delta_e"] - steady))
    return [first, second, Record(name="third", t=more.t, channels=dict(more.channels))]


def test_a_surface_that_is_recorded_too_large_has_changed_in_its_flight_alone() -> None:
    """Its effectiveness is as much smaller there, but for what the prior draws it to the file."""
    factor = 1.5
    found = compare_flights(aircraft_file(), flights(factor))
    rows = {one.record: {change.parameter: change for change in one.changes} for one in found.flights}
    change = rows["third"]["Cm_delta_e"]
    assert change.value / change.others == pytest.approx(1.0 / factor, rel=0.15)
    errors = {one.record: one.error for one in found.flights}
    assert max(errors, key=lambda name: errors[name]) == "third"
    assert {str(row[0]): row[2] for row in found.rows().rows} == errors
    assert found.changed and json.dumps(found.to_dict(), allow_nan=False)


def test_flights_that_are_the_same_have_not_changed() -> None:
    found = compare_flights(aircraft_file(), flights(1.0))
    assert not any(one.changes for one in found.flights)


def test_one_flight_is_compared_with_nothing() -> None:
    with pytest.raises(InputError, match="at least two"):
        compare_flights(aircraft_file(), records()[:1])
