"""The figure of a test. Truth: the tolerance about flight, and where a simulation was put out of it."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.cli.options import DEMO
from casid.report.figure import Band, Curve
from casid.report.match_page import match_figure, related_figure
from casid.report.svg import paint


@pytest.fixture(scope="module")
def proof() -> cs.ProofOfMatch:
    return cs.proof_of_match(DEMO / "aircraft.toml", DEMO / "m4.csv", tests={"2.c.10": (6.5, 13.0)})


def test_a_panel_for_each_channel_in_the_unit_of_its_tolerance(proof: cs.ProofOfMatch) -> None:
    (one,) = proof.tests
    picture = match_figure(one)
    shown = picture.figure.panels
    assert [panel.y.label for panel in shown][:3] == [
        "pitch angle [deg]",
        "pitch rate [deg/s]",
        "normal acceleration [g]",
    ]
    lines = {one.look.name: one.y for one in shown[0].of(Curve)}
    assert np.allclose(lines["measured"], np.degrees(one.flight.curves["theta"]))
    assert np.allclose(lines["as given"], np.degrees(one.sides["as given"].flown.channels["theta"]))


def test_the_band_is_the_tolerance_about_flight(proof: cs.ProofOfMatch) -> None:
    (one,) = proof.tests
    (band,) = match_figure(one).figure.panels[0].of(Band)
    curve = np.degrees(one.flight.curves["theta"])
    assert band.high.max() == pytest.approx(curve.max() + 1.5)
    assert band.low.min() == pytest.approx(curve.min() - 1.5)


def test_all_of_the_legend_is_on_the_figure(proof: cs.ProofOfMatch) -> None:
    """Geometry of the drawn figure, with a second aircraft in it, on the page and as `plot` shows it."""
    from matplotlib import pyplot

    both = cs.proof_of_match(
        DEMO / "aircraft.toml", DEMO / "m4.csv", extended=DEMO / "aircraft.toml", tests={"2.c.10": (6.5, 13.0)}
    )
    for figure in (paint(match_figure(both.tests[0]).figure), both.plot()):
        figure.draw_without_rendering()
        legend = figure.legends[0].get_window_extent()
        assert legend.x0 >= 0.0 and legend.x1 <= figure.bbox.x1
    pyplot.close("all")


def test_plot_finds_a_test_by_its_id(proof: cs.ProofOfMatch) -> None:
    from matplotlib import pyplot

    assert proof.plot("2.c.10") is not None
    pyplot.close("all")
    with pytest.raises(cs.InputError, match=r"2\.c\.10"):
        proof.plot("2.c.9")


def test_a_row_for_each_check_in_the_frame(proof: cs.ProofOfMatch) -> None:
    pytest.importorskip("pandas")
    table = proof.to_frame()
    assert len(table) == 3 and set(table["paragraph"]) == {proof.tests[0].test.paragraph}


def test_no_label_is_longer_than_its_panel_is_wide() -> None:
    """Truth: where the text stands, as it is drawn. Power change: the longest names, and the thrust."""
    proof = cs.proof_of_match(
        DEMO / "aircraft.toml", DEMO / "m2.csv", extended=DEMO / "aircraft.toml", tests={"2.c.1": (14.5, 20.4)}
    )
    (one,) = proof.tests
    for picture in (match_figure(one), related_figure(one)):
        figure = paint(picture.figure) if picture else None
        if figure is None:
            continue
        figure.draw_without_rendering()
        for axis in figure.axes:
            heading = axis._left_title  # pyright: ignore[reportAttributeAccessIssue]
            assert heading.get_window_extent().width <= axis.get_window_extent().width, heading.get_text()
