"""The Bode diagram of a cause. Truth: the cause, which says where it acts, and the fits that it is drawn from."""

from __future__ import annotations

from dataclasses import replace

import pytest

from casid.diagnosis.cause import Cause
from casid.diagnosis.document import Document, ReportedCause
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.shown import drawn_cause
from casid.model.effect import Effect
from casid.model.effects import effect_named
from casid.report.cause_figures import cause_response
from casid.report.figure import Curve, Picture
from casid.report.page import write_report
from casid.report.svg import svg


def told(diagnosis: Diagnosis, named: Cause) -> ReportedCause:
    return drawn_cause(named, diagnosis.bare, (diagnosis.as_given, diagnosis.extended), {})


def drawn(diagnosis: Diagnosis, document: Document, named: Cause) -> Picture | None:
    return cause_response(document, told(diagnosis, named))


def cause(diagnosis: Diagnosis, effect: Effect, value: float = 0.1, onset_s=None) -> Cause:
    """The named cause of the small flight as another effect."""
    return replace(diagnosis.causes[0], effect=effect, value=value, onset_s=onset_s, records=())


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("actuator_lag(delta_e)", "q to delta_e"),
        ("input_delay(delta_a)", "p to delta_a"),
        ("sensor_delay(q)", "q to delta_e"),
        ("dead_zone(delta_e)", "q to delta_e"),
    ],
)
def test_it_is_drawn_of_what_the_cause_acts_on(diagnosis: Diagnosis, document: Document, name: str, shown: str) -> None:
    picture = drawn(diagnosis, document, cause(diagnosis, effect_named(name)))
    assert picture is not None and shown in picture.alt
    gain, _, phase, _ = picture.figure.panels
    assert len(gain.of(Curve)) == len(phase.of(Curve)) == 4  # flight twice, file as given, extended model
    assert b"<svg" in svg(picture.figure)


def test_an_aerodynamic_term_has_none(diagnosis: Diagnosis, document: Document) -> None:
    assert drawn(diagnosis, document, diagnosis.causes[0]) is None


def test_an_effectiveness_is_drawn_from_its_onset_on(diagnosis: Diagnosis, document: Document) -> None:
    """Too short a rest is no record, and there is no diagram of it."""
    late = {name: (7.0, 7.4) for name in diagnosis.extended.records}
    change = effect_named("effectiveness_change(delta_e)")
    assert drawn(diagnosis, document, cause(diagnosis, change, -0.3, late)) is None
    early = {name: (0.1, 0.2) for name in diagnosis.extended.records}
    picture = drawn(diagnosis, document, cause(diagnosis, change, -0.3, early))
    assert picture is not None and "onset" in picture.caption


def test_it_stands_on_the_page(diagnosis: Diagnosis, document: Document, tmp_path) -> None:
    lag = told(diagnosis, cause(diagnosis, effect_named("actuator_lag(delta_e)")))
    write_report(replace(document, causes=(lag,)), tmp_path)
    assert (tmp_path / "report_figures" / "bode.svg").is_file()
    assert "as gain and phase" in (tmp_path / "report.html").read_text(encoding="utf-8")
