"""A search that must end early: the verdict so far, with what was not tried. Truth: a tank with a hidden fault."""

from __future__ import annotations

import json
import signal
import threading
import time

import numpy as np
import pytest

import casid as cs
from casid.cli.options import DEMO
from casid.diagnosis.time_limit import TimeIsUpError, TimeLimit
from casid.keeping import plain
from casid.records.thinning import thinned
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
    assert not cut.causes and "no cause was tried" in cut.sentence
    assert cut.nothing is None and not cut.entered and not cut.explanations  # these would be of the whole catalogue
    assert cut.not_tried[0].what == "the causes of the catalogue"
    document = cut.to_dict()
    assert plain(cut.not_tried) == document["not_judged"][: len(cut.not_tried)]
    assert all(one.what in str(cut) for one in cut.not_tried)
    write_report(cut, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the limit of 0.001 s was reached" in page and "no cause of the catalogue" not in page


def test_causes_that_were_not_fitted_are_listed(whole: cs.Diagnosis):
    def report(stage: str) -> None:
        if stage == "naming, round 1":
            time.sleep(3.0)

    cut = diagnosed(seconds=3.0, report=report)
    tried = {t.candidate.name for r in whole.rounds for t in r.trials}
    assert set(cut.not_tried[0].what.removeprefix("fits of ").split(", ")) & tried
    assert "that were tried" in cut.sentence


@pytest.mark.parametrize("interrupted", [False, True])
def test_an_aircraft_has_its_verdict_without_the_kinematics(interrupted: bool):
    """The simulation as given and the re-estimated file are judged on the held-out record; no cause is named."""
    records = [thinned(one, 12.5) for one in cs.read_records(DEMO / "m*.csv")]
    said: list[str] = []

    def report(stage: str) -> None:
        said.append(stage)
        if interrupted and stage == "kinematics":
            signal.raise_signal(signal.SIGINT)

    limit = {} if interrupted else {"seconds": 1e-3}
    cut = cs.diagnose(DEMO / "aircraft.toml", records, report=report, **limit)
    listed = [one.what for one in cut.not_tried]
    assert any("kinematics" in one for one in listed) and "the causes of the catalogue" in listed
    assert not cut.causes and not any(one.startswith("naming") for one in said)
    together = cut.budget.together
    assert together.over("as_given") > 1.0 and np.isfinite(together.over("structure"))
    assert ("interrupted" in cut.not_tried[0].because) is interrupted


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
            signal.raise_signal(signal.SIGINT)

    cut = diagnosed(report=report)
    assert {one.because for one in cut.not_tried} <= {"not tried: the search was interrupted"}
    assert cut.not_tried or round_ > 1  # the last round may have nothing that is worth a fit
    assert [c.key for c in cut.causes] == [c.key for c in whole.causes][: round_ - 1]
    assert any("interrupted" in one for one in said)


def test_data_and_the_simulation_as_given_are_told_before_any_cause_is_tried(said: list[str], whole: cs.Diagnosis):
    at = next(i for i, one in enumerate(said) if one.startswith("so far:"))
    assert not any(one.startswith("naming") for one in said[:at])
    assert whole.held_out_as_given.records[0] in said[at] and "times the noise" in said[at]


@pytest.mark.parametrize("part", [0.02, 0.2, 0.4, 0.6, 0.8])
def test_ctrl_c_at_any_time_gives_results(part: float, whole: cs.Diagnosis):
    """A signal after a part of the time that the whole takes: its results, those of the model as given at least."""
    before = signal.signal(signal.SIGINT, lambda *_: None)  # of a signal that comes when all is done
    own = signal.getsignal(signal.SIGINT)
    asked = threading.Timer(part * sum(whole.seconds.values()), signal.raise_signal, (signal.SIGINT,))
    try:
        asked.start()
        found = diagnosed()
        assert signal.getsignal(signal.SIGINT) is own
    finally:
        asked.join()
        signal.signal(signal.SIGINT, before)
    assert found.budget.together.over("as_given") == whole.budget.together.over("as_given")
    assert json.dumps(plain(found.to_dict()), allow_nan=False)


def test_a_second_ctrl_c_ends_the_diagnosis():
    def report(stage: str) -> None:
        if stage.startswith(("naming", "held-out")):
            signal.raise_signal(signal.SIGINT)

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
