"""Sections of a page that a script composes. Truth: what the script gave, in its order, and links of HTML."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import casid as cs
from casid.diagnosis.document import Document
from casid.frames import Rows
from casid.report.page import FIGURES


@pytest.fixture(scope="module")
def report(document: Document) -> cs.Report:
    return cs.Report.of(document)


def own_figure() -> Figure:
    figure = Figure(figsize=(4.0, 3.0))
    figure.add_subplot().plot([0.0, 1.0], [2.0, 3.0])
    return figure


def test_a_page_has_the_sections_of_a_script_in_its_order_and_no_other(report: cs.Report, tmp_path: Path) -> None:
    own = cs.Section(
        title="Wind <tunnel>",
        name="tunnel",
        parts=[
            "As of <May>.",
            ["first & last", "second"],
            {"Mach": [0.3, 0.45], "run": ["a", "b<c>"]},
            Rows(heads={"name": "", "value": ".3f"}, rows=[("Cm_q", -21.98765)]),
            own_figure(),
        ],
    )
    kept = [one for one in report.sections if one.name in ("numbers", "values")]
    assert cs.write_report(replace(report, sections=[own, *kept[::-1]]), tmp_path) == []
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<summary><h2 id="([^"]+)"', page) == ["tunnel", "numbers", "values"]
    told = page[page.index('<h2 id="tunnel"') : page.index('<h2 id="numbers"')]
    for word in (
        "Wind &lt;tunnel&gt;",
        "As of &lt;May&gt;.",
        "<li>first &amp; last</li>",
        ">0.45<",
        "b&lt;c&gt;",
        ">-21.988<",
    ):
        assert word in told, word
    (image,) = re.findall(r"base64,([A-Za-z0-9+/=]+)", told)
    assert base64.b64decode(image) in {path.read_bytes() for path in (tmp_path / FIGURES).glob("*.svg")}


@pytest.mark.usefixtures("undrawn")
def test_a_page_without_a_section_has_no_link_to_it(report: cs.Report, tmp_path: Path) -> None:
    for left_out in ("account", "evidence"):
        sections = [one for one in report.sections if one.name != left_out]
        cs.write_report(replace(report, sections=sections), tmp_path)
        page = (tmp_path / "report.html").read_text(encoding="utf-8")
        ids = set(re.findall(r'id="([^"]+)"', page))
        assert left_out not in ids and set(re.findall(r'href="#([^"]+)"', page)) <= ids


def test_a_figure_in_a_window_stays_in_it(report: cs.Report, tmp_path: Path) -> None:
    figure = own_figure()
    canvas = figure.canvas
    cs.write_report(replace(report, sections=[cs.Section(title="Own", parts=[figure])]), tmp_path)
    assert figure.canvas is canvas


@pytest.mark.parametrize("part", [3, None, b"x", {"a": [1], "b": [1, 2]}, {"a": 3}, {}, [3], cs.Section, object()])
def test_what_cannot_stand_on_a_page_is_refused_in_a_line(part: object) -> None:
    with pytest.raises(cs.InputError) as refused:
        cs.Section(title="Own", parts=[part])
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("sections", [None, "text", ["text"], [None], 3])
def test_sections_of_a_report_are_sections(report: cs.Report, tmp_path: Path, sections: object) -> None:
    with pytest.raises(cs.InputError, match="Section"):
        cs.write_report(replace(report, sections=sections), tmp_path)  # pyright: ignore[reportArgumentType]
