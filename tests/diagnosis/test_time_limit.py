"""A search that must end early: the verdict so far, with what was not tried. Truth: a tank with a hidden fault."""

from __future__ import annotations

import time

import pytest

import casid as cs
from casid.diagnosis.time_limit import TimeIsUpError, TimeLimit
from casid.keeping import plain
from casid.report.page import write_report
from problems.systems.count import flown
from problems.systems.quadruple_tank import SYSTEM


def diagnosed(**others):
    records = flown(SYSTEM, 1, clean=False)[1]
    return cs.diagnose(SYSTEM.model(), records, ports=SYSTEM.ports(), library=SYSTEM.library, **others)


@pytest.fixture(scope="module")
def said() -> list[str]:
    """What the diagnosis to the end reports."""
    return []


@pytest.fixture(scope="module")
def whole(said: list[str]) -> cs.Diagnosis:
    """The diagnosis to the end."""
    return diagnosed(report=said.append)


def test_without_time_everything_that_was_not_tried_is_listed(tmp_path, whole: cs.Diagnosis):
    cut = diagnosed(seconds=1e-3)
    assert not whole.not_tried and cut.not_tried
    assert {one.because for one in cut.not_tried} == {"not tried: the limit of 0.001 s was reached"}
    assert not cut.causes and "that were tried" in cut.sentence
    assert cut.nothing is None and not cut.entered and not cut.explanations  # these would be of the whole catalogue
    tried = {t.candidate.name for r in whole.rounds for t in r.trials}
    assert set(cut.not_tried[0].what.removeprefix("fits of ").split(", ")) & tried
    document = cut.to_dict()
    assert plain(cut.not_tried) == document["not_judged"][: len(cut.not_tried)]
    assert all(one.what in str(cut) for one in cut.not_tried)
    write_report(cut, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the limit of 0.001 s was reached" in page and "no cause of the catalogue" not in page


def test_with_time_enough_the_limit_changes_nothing(whole: cs.Diagnosis):
    limited = diagnosed(seconds=1e6)
    assert not limited.not_tried and limited.sentence == whole.sentence
    assert [c.to_dict() for c in limited.causes] == [c.to_dict() for c in whole.causes]


@pytest.mark.parametrize("round_", [1, 2])
def test_ctrl_c_gives_the_verdict_so_far(round_: int, whole: cs.Diagnosis):
    said: list[str] = []

    def report(stage: str) -> None:
        said.append(stage)
        if stage == f"naming, round {round_}":
            raise KeyboardInterrupt

    cut = diagnosed(report=report)
    assert {one.because for one in cut.not_tried} == {"not tried: the search was interrupted"}
    assert [c.key for c in cut.causes] == [c.key for c in whole.causes][: round_ - 1]
    assert any("interrupted" in one for one in said)


def test_data_and_the_simulation_as_given_are_told_before_any_cause_is_tried(said: list[str], whole: cs.Diagnosis):
    at = next(i for i, one in enumerate(said) if one.startswith("so far:"))
    assert not any(one.startswith("naming") for one in said[:at])
    assert whole.held_out_as_given.records[0] in said[at] and "times the noise" in said[at]


def test_a_second_ctrl_c_ends_the_diagnosis():
    def report(stage: str) -> None:
        if stage.startswith(("naming", "held-out")):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnosed(report=report)


def test_as_much_time_is_kept_for_the_verdict_as_the_beginning_took():
    limit = TimeLimit(0.2)
    time.sleep(0.05)
    limit.begin_search()
    assert not limit.is_up
    time.sleep(0.11)
    assert limit.is_up and limit.because
    limit.check()  # nothing is cut here
    with limit.cutting(), pytest.raises(TimeIsUpError):
        limit.check()


@pytest.mark.parametrize("seconds", [0.0, -1.0, "5", float("nan")])
def test_a_limit_is_a_positive_number(seconds):
    with pytest.raises(cs.InputError, match="seconds"):
        diagnosed(seconds=seconds)
