"""Relations of kinematics. Truth: a simulated flight without noise, in which both sides of every relation are equal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

import casid as cs
from casid.data_check.criteria import DataCriteria
from casid.data_check.reading import Read, Reading, smooth
from casid.data_check.relations import RELATIONS, agreement
from casid.model.path import GROUND
from casid.records.record import Record
from problems.every_problem import DEMO

BY = DataCriteria(close=1e-4)
G = 9.80665
OUTPUTS = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "ax",
    "ay",
    "az",
    "pdot",
    "qdot",
    "rdot",
    "altitude",
    *GROUND,
)


@pytest.fixture(scope="module")
def flight() -> Record:
    """Steps on all surfaces: 5 deg of incidence and of sideslip, 40 deg of bank."""
    plane = cs.Aircraft.read(DEMO / "aircraft.toml")
    level, t = cs.trim(plane, V=plane.trim["V"], altitude=plane.trim["altitude"]), np.arange(1500) / 50.0
    inputs = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    for name, size, start in (("delta_e", 0.05, 1.0), ("delta_a", 0.06, 6.0), ("delta_r", 0.08, 14.0)):
        inputs[name] = inputs[name] + size * np.sign(np.sin(2.0 * (t - start))) * ((t > start) & (t < start + 6.0))
    flown = cs.simulate(
        cs.aircraft_model(plane, outputs=OUTPUTS), Record(name="m", t=t, channels=inputs), [*level.state, 0.3, 2500.0]
    )
    record = flown.as_record("m")
    places = {
        name: integrate.cumulative_trapezoid(record[velocity], record.t, initial=0.0)
        for name, velocity in zip(("north", "east"), GROUND[:2], strict=True)
    }
    return record.with_channels(**places)


def read(record: Record, relation, reading: Reading | None = None) -> Read:
    return Read(smooth(record, BY.slow if relation.slow else BY.quick, BY), reading or Reading())


@pytest.mark.parametrize("relation", RELATIONS, ids=lambda one: one.name)
def test_both_sides_are_equal_in_flight_and_unlike_when_a_channel_is_turned_round(relation, flight: Record) -> None:
    """Both are smoothed by one window, so that they are equal but for what is not linear in its motion."""
    rate, made = relation.sides(read(flight, relation), G)
    well = read(flight, relation).known(*relation.uses)
    assert np.std((rate - made)[well]) < 0.3 * np.std(rate[well])
    found = agreement(relation, read(flight, relation), G, BY)
    assert found is not None and found.unlike < (0.05 if relation.slow else 0.02) and found.log_likelihood > 0.0
    turned = read(flight, relation, Reading(factor={relation.name: -1.0}))
    other = agreement(relation, turned, G, BY)
    assert other is not None and other.unlike > 0.5 and other.log_likelihood < 0.3 * found.log_likelihood


@pytest.mark.parametrize("name", ["phi", "theta", "beta", "qdot"])
def test_ordinary_errors_of_healthy_instruments_cost_little(name: str, flight: Record) -> None:
    """A delay of one deviation, a bias and a drift of what is measured; thirty times that delay costs far more."""
    (relation,) = (one for one in RELATIONS if one.name == name)
    target = "q" if name == "qdot" else name

    def late(seconds: float) -> float:
        moved = np.interp(flight.t - seconds, flight.t, flight[target])
        with_bias = flight.with_channels(**{target: moved + 0.02 + 0.002 * flight.t})
        found = agreement(relation, read(with_bias, relation), G, BY)
        assert found is not None
        return found.unlike

    assert late(0.0) < 0.02 and late(BY.late) < 0.03 and late(-BY.late) < 0.03
    assert late(30.0 * BY.late) > 10.0 * late(BY.late)


def test_a_relation_says_nothing_without_its_channels(flight: Record) -> None:
    for relation in RELATIONS:
        for needed in relation.needs:
            assert agreement(relation, read(flight.without(needed), relation), G, BY) is None
        gone = np.where(flight.t > 1.0, np.nan, flight[relation.needs[0]])
        assert agreement(relation, read(flight.with_channels(**{relation.needs[0]: gone}), relation), G, BY) is None


@pytest.mark.parametrize("scale", [0.5, 0.97, 1.03, 2.0])
def test_a_scale_that_instruments_have_is_no_question_of_units(scale: float, flight: Record) -> None:
    """Truth: the covariance of a signal and its multiple: 1 - 1 / scale of the larger is left."""
    (relation,) = (one for one in RELATIONS if one.name == "theta")
    found = agreement(relation, read(flight, relation, Reading(factor={"theta": scale})), G, BY)
    assert found is not None
    assert (found.unlike < 0.02) == (1.0 / BY.own_scale < scale < BY.own_scale)


@pytest.mark.parametrize("pairs", [("north", "east", *GROUND[:2]), GROUND[:2], ("north", "east")], ids="+".join)
def test_north_and_east_interchanged_are_told(pairs: tuple[str, ...], flight: Record) -> None:
    """Truth: a frame of the earth is right-handed, and specific force says where its axes are. A flight near north
    shows it; nothing is found as long as they are right."""
    rng = np.random.default_rng(7)
    noisy = {name: x + 1e-3 * np.std(x) * rng.standard_normal(len(x)) for name, x in flight.channels.items()}
    flight = replace(flight, channels=noisy)
    assert not cs.check([flight]).findings
    wrong = {}
    for a, b in zip(pairs[::2], pairs[1::2], strict=True):
        wrong |= {a: flight[b], b: flight[a]}
    found = cs.check([flight.with_channels(**wrong)]).findings
    assert [(one.kind, one.target, one.handled) for one in found] == [("data_swap", "+".join(pairs), "corrected")]
