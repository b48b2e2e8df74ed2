"""The flight card of a manoeuvre. Truth: the steps from which the manoeuvre is made."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from estimation_cases import NOISE, short_period
from hypothesis import given
from hypothesis import strategies as st

from casid.design import Experiment
from casid.design.flight_card import flight_card
from casid.records.record import Record

DT = 0.04
TRIM = 0.02  # rad
LIMIT = 0.04  # rad
EXPERIMENT = Experiment(
    model=short_period(),
    surfaces={"delta_e": 0.1},
    rest={"delta_e": TRIM},
    start=np.zeros(2),
    noise=NOISE,
    duration=8.0,
    dt=DT,
    parameters=["*"],
    limits={"alpha": LIMIT},
)
STEPS = st.lists(st.tuples(st.integers(3, 20), st.sampled_from([-3.0, -1.5, 1.5, 3.0])), min_size=1, max_size=8)


def flown(steps: list[tuple[int, float]]) -> tuple[Record, list[tuple[float, float]]]:
    """Return a record of deflections [deg from trim], each for some samples, and where each level begins."""
    levels = [0.0] * 5
    begins = []
    for count, level in steps:
        if level != levels[-1]:
            begins.append((len(levels) * DT, level))
        levels += [level] * count
    begins.append((len(levels) * DT, 0.0))
    levels += [0.0] * 5
    t = DT * np.arange(len(levels))
    alpha = 0.01 * np.sin(t)
    channels = {"delta_e": TRIM + np.radians(levels), "alpha": alpha, "q": 0.01 * np.cos(t)}
    return Record(name="m", t=t, channels=channels), begins


@given(steps=STEPS)
def test_the_movements_are_those_of_the_manoeuvre(steps: list[tuple[int, float]]) -> None:
    record, begins = flown(steps)
    card = flight_card(record, EXPERIMENT)
    assert [(one.t, one.change["delta_e"]) for one in card.movements] == [pytest.approx(one) for one in begins]
    assert card.trim["delta_e"] == pytest.approx(np.degrees(TRIM)) and card.units["delta_e"] == "deg"


@given(steps=STEPS)
def test_an_autopilot_gets_the_whole_command_in_the_unit_of_its_head(steps: list[tuple[int, float]]) -> None:
    record, _ = flown(steps)
    rows = list(csv.DictReader(io.StringIO(flight_card(record, EXPERIMENT).to_csv())))
    assert set(rows[0]) == {"t_s", "delta_e_change_deg"}
    assert [float(row["t_s"]) for row in rows] == pytest.approx(list(record.t), rel=1e-5)
    again = np.radians([float(row["delta_e_change_deg"]) for row in rows]) + TRIM
    assert again == pytest.approx(record["delta_e"], abs=1e-6)


def test_what_is_expected_has_its_limit_and_its_unit() -> None:
    record, _ = flown([(5, 3.0)])
    card = flight_card(record, EXPERIMENT)
    by = {one.channel: one for one in card.expected}
    change = np.degrees(record["alpha"] - record["alpha"][0])
    assert (by["alpha"].least, by["alpha"].most) == pytest.approx((change.min(), change.max()))
    assert by["alpha"].limit == pytest.approx(np.degrees(LIMIT)) and card.units["alpha"] == "deg"
    assert np.isnan(by["q"].limit)


def test_a_sum_of_sines_has_no_steps_to_read() -> None:
    t = DT * np.arange(200)
    command = TRIM + 0.05 * np.sin(3.0 * t) + 0.02 * np.sin(7.0 * t)
    record = Record(name="m", t=t, channels={"delta_e": command, "alpha": 0.0 * t, "q": 0.0 * t})
    assert flight_card(record, EXPERIMENT).movements == ()
