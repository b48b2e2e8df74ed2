"""Progress of long work. Truth: a work that keeps to its course, and one that is twice as slow."""

from __future__ import annotations

import math

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
    assert course.step() == "4/4"


def test_stages_that_are_skipped_or_come_besides_are_counted() -> None:
    course = Course(stages=STAGES)
    course.begin("read")
    course.begin("write")
    assert (course.step(), course.in_all(3.0)) == ("2/2", pytest.approx(3.0 * 0.3 / 0.2))
    course.begin("write again")
    assert course.step() == "3/3" and course.in_all(6.0) == pytest.approx(6.0 * 0.4 / 0.3)


def test_without_a_terminal_each_stage_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(course=Course(stages=STAGES)) as stage:
        stage("read")
        stage("fit")
    first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("s    1/4  read") and "2/4  fit, roughly" in second and second.endswith("s in all")


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(quiet=True) as stage:
        stage("read")
    assert capsys.readouterr().out == ""
