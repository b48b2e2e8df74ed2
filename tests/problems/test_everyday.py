"""The faults of every week, through a whole diagnosis. Truth: what was put into a short flight of the Do 328."""

from __future__ import annotations

from dataclasses import replace

import pytest

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from problems.faults.everyday import ALL, ROWS, healthy
from problems.faults.fault import DataFault, with_fault
from problems.faults.score import RIGHT

BY_NAME = {row.name: row for row in ROWS}


def diagnosed(name: str) -> tuple[str, Diagnosis]:
    aircraft, records = BY_NAME[name].fly()
    found = diagnose(aircraft, records[:2], hold_out=records[2:])
    return BY_NAME[name].outcome(found), found


@pytest.mark.parametrize(
    "name",
    [
        "elevator reversed in all",
        "no delta_e, Cm_delta_e of the file reversed",
        "surfaces 0.12 s late",
    ],
)
@pytest.mark.slow
def test_a_fault_is_named_and_nothing_else_is(name: str) -> None:
    outcome, found = diagnosed(name)
    assert outcome in RIGHT, str(found)
    assert found.verdict != "adequate" or BY_NAME[name].fault is None or found.data


@pytest.mark.slow
def test_a_sign_of_the_record_or_of_the_file_is_told_as_both() -> None:
    """An aileron that one derivative alone knows: record or file has the wrong sign, and no cause is named."""
    aircraft, records = healthy()
    alone = aircraft.with_derivatives({"Cn_delta_a": 0.0, "CY_delta_a": 0.0})
    reversed_aileron = with_fault(DataFault(kind="data_sign", target="delta_a", records=ALL), records, 5)
    found = diagnose(alone, reversed_aileron[:2], hold_out=reversed_aileron[2:])
    document = found.to_dict()
    assert found.causes == () and found.contradicted[0].parameter == "Cl_delta_a"
    (told,) = document["data"]
    assert told["handled"] == "reported" and "delta_a: sign" in told["sentence"] and "Cl_delta_a" in told["sentence"]


@pytest.mark.slow
def test_a_file_that_cannot_be_right_is_the_verdict() -> None:
    """Mass in lb: no cause is named, and the file is told."""
    aircraft, records = healthy()
    found = diagnose(replace(aircraft, mass=aircraft.mass / 0.45359237), records[:2], hold_out=records[2:])
    assert found.verdict == "values wrong" and found.causes == ()
    assert "mass is in lb" in found.sentence
    assert found.contradicted[0].impossible and found.contradicted[0].parameter == "mass"


def test_a_file_with_which_nothing_flies_is_named_in_the_error() -> None:
    aircraft, records = healthy()
    with pytest.raises(InputError, match="of the aircraft file: mass is in t"):
        diagnose(replace(aircraft, mass=aircraft.mass / 1000.0), records[:2], hold_out=records[2:])
