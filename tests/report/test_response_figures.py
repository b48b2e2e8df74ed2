"""Bode diagrams show what the responses have. Truth: these responses."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.frequency.response import FrequencyResponse
from casid.report.figure import Curve, Span
from casid.report.response_figures import bode, bode_mismatch

OMEGA = np.geomspace(0.5, 20.0, 60)


@pytest.fixture
def flight() -> FrequencyResponse:
    """An elevator to a pitch rate; below 1 and above 8 rad/s the coherence is low."""
    ones = np.ones(len(OMEGA))
    return FrequencyResponse(
        input="delta_e",
        output="q",
        other_inputs=(),
        omega=OMEGA,
        response=-2.0 * np.exp(-0.2j * OMEGA) / (1.0 + 0.3j * OMEGA),
        coherence=np.where((OMEGA > 1.0) & (OMEGA < 8.0), 0.9, 0.2),
        multiple_coherence=ones,
        random_error=0.02 * ones,
        averages=10.0 * ones,
        input_spectrum=ones,
        output_spectrum=ones,
        windows={10.0: 10.0},
        records=("m1", "m2"),
    )


def test_low_coherence_is_grey(flight: FrequencyResponse) -> None:
    """Grey ends half way, by ratio, between a usable frequency and its neighbour."""
    figure = bode(flight).figure
    usable = np.flatnonzero(flight.usable)
    below, above = (float(np.sqrt(OMEGA[k] * OMEGA[k + 1])) for k in (usable[0] - 1, usable[-1]))
    for panel in figure.panels:
        grey = sorted((one.low, one.high) for one in panel.of(Span))
        assert grey == [pytest.approx((OMEGA[0], below)), pytest.approx((above, OMEGA[-1]))]


def test_curves_are_the_response_where_it_is_usable(flight: FrequencyResponse) -> None:
    picture = bode(flight)
    gain, phase, coherence = picture.figure.panels
    for panel, values in ((gain, flight.gain_db), (phase, flight.phase_deg)):
        faint, solid = (one.y for one in panel.of(Curve))
        assert faint == pytest.approx(values)
        assert solid[flight.usable] == pytest.approx(values[flight.usable])
        assert np.isnan(solid[~flight.usable]).all()
    assert coherence.of(Curve)[-1].y == pytest.approx(flight.coherence)
    assert "pitch rate q" in picture.title and "m1, m2" in picture.caption


def test_a_model_a_turn_away_is_drawn_beside_flight(flight: FrequencyResponse) -> None:
    """Its phase is known but for whole turns: -2 begins at 180 deg for one and at -180 deg for the other."""
    compared = cs.compare_responses(
        flight, {"m": lambda w: np.conj(-2.0 + 0.0j) * np.exp(-0.2j * w) / (1.0 + 0.3j * w)}
    )
    figure = bode_mismatch(compared).figure
    model = figure.panels[1].of(Curve)[-1].y
    assert model[flight.usable] == pytest.approx(flight.phase_deg[flight.usable])


def test_what_leaves_the_envelope_is_marked(flight: FrequencyResponse) -> None:
    bounds = cs.MismatchEnvelope(
        omega=np.array([0.5, 20.0]),
        gain_low_db=np.array([-1.0, -1.0]),
        gain_high_db=np.array([1.0, 1.0]),
        phase_low_deg=np.array([-20.0, -20.0]),
        phase_high_deg=np.array([20.0, 20.0]),
        name="mine",
    )
    late = {"late": lambda w: -2.0 * np.exp(-0.3j * w) / (1.0 + 0.3j * w)}
    compared = cs.compare_responses(flight, late, envelope=bounds)
    figure = bode_mismatch(compared).figure
    out = flight.usable & (np.radians(20.0) / 0.1 < OMEGA)
    for panel in figure.panels[3:]:
        assert panel.of(Curve)[-1].x == pytest.approx(OMEGA[out])
    assert f"J = {compared.mismatches['late'].cost:.3g}" in bode_mismatch(compared).caption


def test_results_draw_themselves(flight: FrequencyResponse) -> None:
    from matplotlib import pyplot

    compared = cs.compare_responses(flight, {"m": lambda w: -2.0 / (1.0 + 0.3j * w)})
    assert len(flight.plot().axes) == 3 and len(compared.plot().axes) == 5
    pyplot.close("all")
