"""A small diagnosis with a known cause, its pictures and its page, made once for all tests of the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_flight import NAMES, aircraft_file, records

from casid.data_check.reading import Finding
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.document import Document
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.result import Diagnosis
from casid.report.figure import Picture
from casid.report.folder import provenance
from casid.report.page import Report, write_report
from casid.report.svg import svg


@pytest.fixture(scope="session")
def diagnosis() -> Diagnosis:
    return diagnose(aircraft_file(), records())


@pytest.fixture(scope="session")
def document(diagnosis: Diagnosis) -> Document:
    return diagnosis.document()


@pytest.fixture(scope="session")
def shown(document: Document) -> dict[str, Picture]:
    report = Report.of(document)
    assert not report.failed
    return report.pictures


@pytest.fixture(scope="session")
def drawn(shown: dict[str, Picture]) -> dict[str, bytes]:
    return {name: svg(picture.figure) for name, picture in shown.items()}


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pages of this test have empty pictures, for tests of their words and links."""
    monkeypatch.setattr("casid.report.templating.svg", lambda figure: b"<svg/>")


@pytest.fixture(scope="session")
def folder(diagnosis: Diagnosis, document: Document, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("report")
    diagnosis.write(place / "diagnosis.json")
    diagnosis.extended_aircraft.write(place / "extended.toml")
    write_report(document, place, provenance(seed=3))
    return place


@pytest.fixture(scope="session")
def wrong_in_all(diagnosis: Diagnosis) -> Document:
    """With a fault of the data, a contradicted value and something unexplained beside the cause."""
    history = {
        name: (t, 0.02 * np.sin(t), 0.001 + 0.0 * t) for name, (t, _, _) in diagnosis.missing_after[0].history.items()
    }
    loud = replace(diagnosis.missing_after[0], station="dCl", gain=1e4, history=history)
    stuck = Finding(
        kind="data_stuck",
        target="beta",
        records=(NAMES[0],),
        intervals_s={NAMES[0]: ((2.0, 3.0),)},
        handled="excluded",
        sentence="The sideslip angle is frozen.",
    )
    against = Contradiction(
        parameter="Cl_p",
        unit="1",
        given=-0.9,
        flight=-0.5,
        std=0.01,
        reversed=False,
        impossible=False,
        sentence="Cl_p.",
    )
    return replace(diagnosis, data=(stuck,), contradicted=(against,), unexplained=(loud,)).document()
