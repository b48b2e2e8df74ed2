"""Sets of multirotors that RotorPy flies, for `scripts/blind.py`."""

from __future__ import annotations

from dataclasses import replace

from casid.model.aircraft import Aircraft
from casid.records.record import Record
from problems.blind.case import Answer, Hidden
from problems.rotors import flown
from problems.rotors.sets import BREEZE, CASES, fly_set

__all__ = ["CASES", "NAME", "flight"]

NAME = "rotors"


def flight(case: str, seed: int) -> tuple[tuple[Record, ...], Aircraft, Answer]:
    """The record, aircraft file and answer of a case and a seed. Raises InputError without RotorPy."""
    found = fly_set(case, seed)
    hidden = () if found.hidden is None else (_hidden(found.hidden, found.record.name),)
    answer = Answer(
        of=NAME,
        case=case,
        seed=seed,
        size=1.0,
        aircraft=found.vehicle,
        hidden=hidden,
        mismatch={},
        conditions={"rate_hz": flown.RATE_HZ, "durations_s": (flown.DURATION_S,), "breeze": BREEZE},
        besides=tuple(replace(one, target="y") for one in hidden if one.kind == "body_drag"),
    )
    return (found.record,), found.aircraft, answer


def _hidden(one: flown.Hidden, record: str) -> Hidden:
    onset = {record: one.at} if one.at else None
    return Hidden(kind=one.kind, target=one.target, term=one.term, value=one.value, records=(record,), onset_s=onset)
