"""The picture of a check. Truth: the channels and samples that were made wrong."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.records.record import Record
from casid.report.data_pages import check_figure
from casid.report.figure import Curve, Span
from problems.blind.sets import fly_set


@pytest.fixture(scope="module")
def healthy() -> Record:
    return fly_set("do328", "clean-1", 1).records[0]


def test_suspected_channels_are_drawn_as_recorded_and_as_they_should_be(healthy: Record) -> None:
    """In degrees: the reversed pitch rate twice; of the other channel the outlier is marked."""
    q, az = -healthy["q"], healthy["az"].copy()
    az[[300, 500]] += 40.0
    found = cs.check(healthy.with_channels(q=q, az=az))
    suspected = {row[0]: row[-1] for row in found.rows().rows}
    assert {name for name, kinds in suspected.items() if kinds} == {"q", "az"} and suspected["q"] == "sign"
    picture = check_figure(found.findings, found.recorded, found.records)
    assert picture is not None
    by_title = {panel.title: panel.of(Curve) for panel in picture.figure.panels}
    recorded, corrected = by_title["pitch rate"]
    assert np.allclose(recorded.y, np.degrees(q))
    assert np.allclose(corrected.y, -np.degrees(q))
    assert len(by_title["vertical specific force"][-1].x) == 2
    assert "pitch rate" in picture.alt


def test_of_clean_data_there_is_no_picture(healthy: Record) -> None:
    found = cs.check(healthy)
    assert check_figure(found.findings, found.recorded, found.records) is None


def test_intervals_of_a_frozen_channel_are_shaded(healthy: Record) -> None:
    """Truth: frozen from the 10th to the 15th second."""
    beta = healthy["beta"].copy()
    low, high = np.searchsorted(healthy.t, [10.0, 15.0])
    beta[low:high] = beta[low]
    found = cs.check(healthy.with_channels(beta=beta))
    picture = check_figure(found.findings, found.recorded, found.records)
    assert picture is not None
    spans = picture.figure.panels[0].of(Span)
    assert any(abs(one.low - 10.0) < 0.1 and abs(one.high - 15.0) < 0.1 for one in spans)
