"""Sets of RotorPy's multirotors. Truths: the vocabulary, the seed, and what each effect does by its definition."""

from __future__ import annotations

import numpy as np
import pytest

from casid.model.vocabulary import KINDS
from problems.blind.case import OUTSIDE
from problems.blind.rotors import CASES, flight
from problems.rotors import flown

pytest.importorskip("rotorpy")


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flights of half a second."""
    monkeypatch.setattr(flown, "DURATION_S", 0.4)
    monkeypatch.setattr(flown, "RUN_IN_S", 0.1)


def test_a_seed_gives_the_same_flight_and_another_seed_another() -> None:
    (one,), aircraft, answer = flight("one-1", 7)
    (again,), *_ = flight("one-1", 7)
    (other,), *_ = flight("one-1", 8)
    for name in one.channels:
        np.testing.assert_array_equal(one[name], again[name])
    assert not np.array_equal(one["p"], other["p"])
    assert aircraft.rotors is not None and answer.hidden[0].target in aircraft.rotors.names


@pytest.mark.parametrize("case", CASES)
def test_what_is_hidden_is_a_word_of_the_vocabulary_or_outside_it(case: str) -> None:
    _, _, answer = flight(case, 7)
    kinds = {one.kind for one in answer.hidden}
    if case.startswith("one"):
        assert kinds <= set(KINDS) and len(kinds) == 1
    else:
        assert kinds == ({case} if case in OUTSIDE else set())
