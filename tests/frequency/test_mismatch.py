"""Mismatch, cost and envelopes against values that follow from their definitions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.frequency.response import FrequencyResponse

OMEGA = np.geomspace(0.5, 20.0, 60)


def flight(coherence: float | np.ndarray = 1.0, response: np.ndarray | None = None) -> FrequencyResponse:
    """A response of flight, as of a first-order lag."""
    ones = np.ones(len(OMEGA))
    return FrequencyResponse(
        input="u",
        output="y",
        other_inputs=(),
        omega=OMEGA,
        response=lag(OMEGA) if response is None else response,
        coherence=coherence * ones,
        multiple_coherence=coherence * ones,
        random_error=0.01 * ones,
        averages=10.0 * ones,
        input_spectrum=ones,
        output_spectrum=ones,
        windows={10.0: 10.0},
        records=("m1",),
    )


def lag(omega: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + 0.3j * omega)


def envelope(db: float = 2.0, deg: float = 10.0) -> cs.MismatchEnvelope:
    return cs.MismatchEnvelope(
        omega=np.array([1.0, 10.0]),
        gain_low_db=np.array([-db, -db]),
        gain_high_db=np.array([db, db]),
        phase_low_deg=np.array([-deg, -deg]),
        phase_high_deg=np.array([deg, deg]),
        name="square",
    )


@pytest.mark.parametrize(
    ("factor", "square"),
    [(10.0 ** (1.0 / 20.0), 1.0), (np.exp(1j * np.radians(10.0)), 1.745), (0.5 + 0.0j, (20.0 * np.log10(2.0)) ** 2)],
)
@pytest.mark.parametrize("coherence", [1.0, 0.7])
def test_the_cost_of_a_constant_mismatch(factor: complex, square: float, coherence: float) -> None:
    """J = 20 W dB^2, or 20 W 0.01745 deg^2, with W = (1.58 (1 - exp(-coherence)))^2."""
    found = cs.compare_responses(flight(coherence), {"m": lambda omega: factor * lag(omega)})
    weight = (1.58 * (1.0 - np.exp(-coherence))) ** 2
    # flight is interpolated between its 60 frequencies, the model is not
    assert found.mismatches["m"].cost == pytest.approx(20.0 * weight * square, rel=5e-3)


def test_a_perfect_model_costs_nothing_and_a_turn_is_none() -> None:
    """A phase that is off by whole turns is no mismatch: 3 s of delay more, at frequencies of a line spectrum."""
    found = cs.compare_responses(flight(), {"m": lag, "turned": lambda w: lag(w) * np.exp(2j * np.pi)})
    for one in found.mismatches.values():
        assert one.cost == pytest.approx(0.0, abs=1e-2)
        assert one.gain_db == pytest.approx(np.zeros(60), abs=1e-12)
        assert one.phase_deg == pytest.approx(np.zeros(60), abs=1e-12)


def test_the_mismatch_is_model_less_flight() -> None:
    found = cs.compare_responses(flight(), {"m": lambda w: 2.0 * lag(w) * np.exp(-0.05j * w)}).mismatches["m"]
    assert found.gain_db == pytest.approx(np.full(60, 20.0 * np.log10(2.0)))
    assert found.phase_deg == pytest.approx(-np.degrees(0.05 * OMEGA))


def test_low_coherence_bounds_the_band() -> None:
    coherence = np.where((OMEGA > 1.0) & (OMEGA < 8.0), 0.9, 0.2)
    found = cs.compare_responses(flight(coherence), {"m": lag})
    inside = OMEGA[(OMEGA > 1.0) & (OMEGA < 8.0)]
    assert found.band == (pytest.approx(inside[0]), pytest.approx(inside[-1]))
    assert found.mismatches["m"].judged.sum() == len(inside)


@pytest.mark.parametrize(("db", "passed"), [(1.99, True), (2.01, False), (-1.99, True), (-2.01, False)])
def test_an_envelope_is_left_at_its_edge(db: float, passed: bool) -> None:
    found = cs.compare_responses(flight(), {"m": lambda w: 10.0 ** (db / 20.0) * lag(w)}, envelope=envelope())
    one = found.mismatches["m"]
    assert one.passed is passed
    assert one.judged.sum() == np.sum((OMEGA >= 1.0) & (OMEGA <= 10.0))  # beyond its table it says nothing
    assert one.within is not None and (one.within[one.judged] == passed).all()


def test_a_delay_leaves_the_envelope_where_its_phase_does() -> None:
    """0.05 s is 10 deg from 3.49 rad/s on."""
    found = cs.compare_responses(flight(), {"m": lambda w: lag(w) * np.exp(-0.05j * w)}, envelope=envelope())
    one = found.mismatches["m"]
    assert one.within is not None
    assert (one.within == (np.radians(10.0) / 0.05 >= OMEGA))[one.judged].all()


def test_bounds_run_over_the_logarithm_of_the_frequency() -> None:
    bounds = cs.MismatchEnvelope(
        omega=np.array([1.0, 100.0]),
        gain_low_db=np.array([-2.0, -4.0]),
        gain_high_db=np.array([2.0, 4.0]),
        phase_low_deg=np.array([-10.0, -30.0]),
        phase_high_deg=np.array([10.0, 30.0]),
    ).bounds(np.array([0.5, 10.0]))
    assert bounds["gain_high_db"] == pytest.approx([np.nan, 3.0], nan_ok=True)
    assert bounds["phase_low_deg"] == pytest.approx([np.nan, -20.0], nan_ok=True)


def test_an_envelope_is_read_from_a_table(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    head = "# bounds of our own\nomega,gain_low_db,gain_high_db,phase_low_deg,phase_high_deg"
    file.write_text(f"{head}\n1,-2,2,-10,10\n10,-2,2,-10,10\n")
    found = cs.compare_responses(flight(), {"m": lag}, envelope=file)
    assert found.envelope is not None and found.envelope.name == "mine"
    assert found.mismatches["m"].passed
    assert found.to_dict()["models"]["m"]["passed"] is True
    assert "within the envelope" in str(found)


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "wrong.csv"
    file.write_text("omega,gain\n1,2\n")
    linear = cs.linear_model(
        cs.define_model(
            "lag",
            states=["x"],
            inputs=["u"],
            parameters={"T": 0.3},
            outputs=["x"],
            dynamics=lambda s: {"x": (s.u - s.x) / s.T},
            output=lambda s: {"x": s.x},
        ),
        {},
    )
    for what, wrong in (
        ("0.6", lambda: cs.compare_responses(flight(0.3), {"m": lag})),
        ("table of models", lambda: cs.compare_responses(flight(), {})),
        ("functions of omega", lambda: cs.compare_responses(flight(), {"m": 3.0})),  # pyright: ignore
        ("unknown output 'y'", lambda: cs.compare_responses(flight(), {"m": linear})),
        ("band", lambda: cs.compare_responses(flight(), {"m": lag}, band=(0.1, 5.0))),
        ("gain_low_db", lambda: cs.compare_responses(flight(), {"m": lag}, envelope=file)),
        ("cannot be read", lambda: cs.MismatchEnvelope.read(tmp_path / "none.csv")),
        ("not below", lambda: envelope(db=-1.0)),
    ):
        with pytest.raises(InputError, match=what):
            wrong()
