"""Progress of long work. Truth: a work that keeps to its course, and one that is twice as slow."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from casid.report.progress import Course, progress

STAGES = (("read", 0.2), ("fit", 0.5), ("fit", 0.2), ("write", 0.1))


@pytest.mark.parametrize("seconds", [10.0, 20.0])
def test_a_work_that_keeps_to_its_course_is_told_its_time(seconds: float) -> None:
    course, elapsed, found = Course(stages=STAGES), 0.0, []
    for name, part in STAGES:
        course.begin(name)
        found.append(course.in_all(elapsed))
        elapsed += part * seconds
    assert math.isnan(found[0]) and found[1:] == pytest.approx([seconds] * 3)


def test_stages_that_are_skipped_take_no_time_and_others_change_nothing() -> None:
    course = Course(stages=STAGES)
    course.begin("read")
    course.begin("write")
    assert course.in_all(30.0) == pytest.approx(30.0 * 0.3 / 0.2)
    course.begin("write again")
    assert course.in_all(40.0) == pytest.approx(40.0 * 0.3 / 0.2)


def test_a_time_that_was_told_never_grows_by_more_than_half() -> None:
    """Stages of random length, from short to long: what the lines tell is at most 1.5 times the least told before."""
    rng, several = np.random.default_rng(58), 0
    for _ in range(400):
        course, elapsed, told = Course(stages=STAGES, limit=rng.choice([np.inf, 20.0])), 0.0, []
        mean = rng.choice([0.5, 2.0, 10.0])
        for name, _ in STAGES:
            told += [float(word) for word in re.findall(r"about (\S+) s in all", course.line(name, elapsed))]
            elapsed += rng.exponential(mean)
        assert all(later <= 1.5 * min(told[: i + 1]) for i, later in enumerate(told[1:]))
        several += len(told) > 1
    assert several > 100


def test_no_more_time_is_told_than_the_limit_allows() -> None:
    course = Course(stages=STAGES, limit=20.0)
    course.begin("read")
    course.begin("fit")
    assert course.in_all(10.0) == 20.0 and math.isnan(course.in_all(25.0))


def test_without_a_terminal_each_stage_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(course=Course(stages=STAGES)) as stage:
        stage("read")
        stage("fit")
    first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("s  read") and "s  fit" in second


def test_a_sentence_is_no_stage(capsys: pytest.CaptureFixture[str]) -> None:
    course = Course(stages=STAGES)
    with progress(course=course) as stage:
        stage("so far: no fault of the data")
    assert capsys.readouterr().out.endswith("s  so far: no fault of the data\n") and math.isnan(course.in_all(1.0))


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(quiet=True) as stage:
        stage("read")
    assert capsys.readouterr().out == ""
