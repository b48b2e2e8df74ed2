"""The figure of a test. Truth: the tolerance about flight, and where a simulation was put out of it."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.cli.options import DEMO
from casid.report.match_page import match_figure, related_figure


@pytest.fixture(scope="module")
def proof() -> cs.ProofOfMatch:
    return cs.proof_of_match(DEMO / "aircraft.toml", DEMO / "m4.csv", tests={"2.c.10": (6.5, 13.0)})


def test_a_panel_for_each_channel_in_the_unit_of_its_tolerance(proof: cs.ProofOfMatch) -> None:
    (one,) = proof.tests
    picture = match_figure(one)
    shown = [axis for axis in picture.figure.axes if axis.get_visible()]
    assert [axis.get_ylabel().replace("\n", " ") for axis in shown][:3] == [
        "pitch angle [deg]",
        "pitch rate [deg/s]",
        "normal acceleration [g]",
    ]
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in shown[0].lines}
    assert np.allclose(lines["flight"], np.degrees(one.flight.curves["theta"]))
    assert np.allclose(lines["as given"], np.degrees(one.sides["as given"].flown.channels["theta"]))


def test_the_band_is_the_tolerance_about_flight(proof: cs.ProofOfMatch) -> None:
    (one,) = proof.tests
    axis = match_figure(one).figure.axes[0]
    edge = axis.collections[0].get_paths()[0].vertices  # pyright: ignore
    curve = np.degrees(one.flight.curves["theta"])
    assert np.asarray(edge)[:, 1].max() == pytest.approx(curve.max() + 1.5)
    assert np.asarray(edge)[:, 1].min() == pytest.approx(curve.min() - 1.5)


def test_all_of_the_legend_is_on_the_figure(proof: cs.ProofOfMatch) -> None:
    """Geometry of the drawn figure, with a second aircraft in it, on the page and as `plot` shows it."""
    from matplotlib import pyplot

    both = cs.proof_of_match(
        DEMO / "aircraft.toml", DEMO / "m4.csv", extended=DEMO / "aircraft.toml", tests={"2.c.10": (6.5, 13.0)}
    )
    for figure in (match_figure(both.tests[0]).figure, both.plot()):
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


def test_no_label_is_longer_than_its_panel_is_high() -> None:
    """Truth: where the text stands, as it is drawn. Power change: the longest names, and the thrust."""
    proof = cs.proof_of_match(
        DEMO / "aircraft.toml", DEMO / "m2.csv", extended=DEMO / "aircraft.toml", tests={"2.c.1": (14.5, 20.4)}
    )
    (one,) = proof.tests
    figures = [match_figure(one).figure, *(picture.figure for picture in [related_figure(one)] if picture)]
    for figure in figures:
        figure.draw_without_rendering()
        for axis in figure.axes:
            if axis.get_visible():
                assert axis.yaxis.label.get_window_extent().height <= axis.get_window_extent().height, axis.get_ylabel()
