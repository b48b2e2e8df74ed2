"""Figures of an estimation show the numbers that they say."""

from __future__ import annotations

import numpy as np
import pytest

from casid.report.estimate_figures import estimates


def test_estimates_stand_at_their_ratio_to_the_reference() -> None:
    """-1.138 where the file has -1.6 is 0.711 of it; an opposite sign is below zero; a zero has no ratio."""
    pairs = {"file": [(-1.6, 0.0), (-0.25, 0.0), (0.0, 0.0)], "flight": [(-1.138, 0.1), (0.2, 0.05), (0.003, 0.001)]}
    ratios, zeros = estimates(["Cm_alpha", "Cl_delta_a", "bias_q"], pairs, "file").figure.axes
    file, flight = (container.lines[0].get_xdata() for container in ratios.containers)
    np.testing.assert_allclose(file, [1.0, 1.0])
    np.testing.assert_allclose(flight, [1.138 / 1.6, -0.8])
    assert [t.get_text() for t in ratios.get_yticklabels()] == ["Cm_alpha", "Cl_delta_a"]
    assert zeros.containers[1].lines[0].get_xdata() == pytest.approx(3.0)  # standard errors
