"""Figures of an estimation show the numbers that they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casid.cli.estimate import pictures
from casid.estimation import Problem, solve
from casid.model.flown_records import flown_records
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from casid.report import looks
from casid.report.estimate_figures import estimates
from casid.report.figure import Curve
from problems.do328 import do328


def test_estimates_stand_at_their_ratio_to_the_reference() -> None:
    """-1.138 where the file has -1.6 is 0.711 of it; an opposite sign is below zero; a zero has no ratio."""
    pairs = {"file": [(-1.6, 0.0), (-0.25, 0.0), (0.0, 0.0)], "flight": [(-1.138, 0.1), (0.2, 0.05), (0.003, 0.001)]}
    ratios, zeros = estimates(["Cm_alpha", "Cl_delta_a", "bias_q"], pairs, "file").figure.panels
    file, flight = ratios.of(Curve)
    np.testing.assert_allclose(file.x, [1.0, 1.0])
    np.testing.assert_allclose(flight.x, [1.138 / 1.6, -0.8])
    assert ratios.y.names == ("Cm_alpha", "Cl_delta_a")
    assert zeros.of(Curve)[1].x == pytest.approx(3.0)  # standard errors
    assert file.look.colour == looks.ORANGE != flight.look.colour, "what is given has one colour in every figure"


def test_a_priori_values_of_an_estimate_have_the_bars_of_their_prior() -> None:
    """30 % of the file's value is a bar of 0.6 to either side of 1; a value of 0 has no prior and no bar."""
    t = np.arange(0.0, 6.0, 0.05)
    free = ["Cm_alpha", "Cm_alpha^2"]
    file = replace(do328(), relative_uncertainty=0.3, terms={"Cm": {"alpha^2": 0.0}})
    level = trim(file, V=144.0, thrust=10e3)
    inputs = {
        name: np.full(len(t), value) for name, value in level.inputs.items() if name not in ("delta_a", "delta_r")
    }
    inputs["delta_e"] = inputs["delta_e"] + np.where(t < 2.0, 0.02, 0.0)
    flown = flown_records(
        file, [Record(name="m1", t=t, channels={**inputs, "V": np.full(len(t), 144.0)})], outputs=["q"]
    )
    state = {"u": level.state[0], "w": level.state[2], "q": 0.0, "theta": level.theta}
    rate = simulate(flown.model, flown.records[0], np.array([state[s] for s in flown.model.states])).output("q")
    applied = flown_records(file, [flown.records[0].with_channels(q=rate + 1e-4 * np.sin(9.0 * t))])
    fit = solve(Problem(applied.model, applied.records, free=free, prior=True))
    (picture,) = [one for one in pictures(applied, fit) if one.name == "estimates"]
    ratios, zeros = (panel.of(Curve)[0] for panel in picture.figure.panels)
    np.testing.assert_allclose([ratios.x - ratios.std_x, ratios.x + ratios.std_x], [[0.4], [1.6]])
    np.testing.assert_allclose([zeros.x - zeros.std_x, zeros.x + zeros.std_x], [[0.0], [0.0]])
