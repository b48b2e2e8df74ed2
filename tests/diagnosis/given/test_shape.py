"""The shape of what is missing. Truth: the function that made the histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from small_flight import NAMES, aircraft_file, records

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_at
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.given.shape import Points, Shape, shape_of, shapes_of, with_shapes
from casid.keeping import plain
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import V_TRIM, do328

RECORDS = 3


def histories(makes: Callable[[np.ndarray, np.ndarray], np.ndarray], seed: int, count: int = RECORDS) -> list[Points]:
    """Motion of three frequencies, and what a function of angle of attack and sideslip makes of it, with noise."""
    rng, t, found = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.25), []
    for _ in range(count):
        alpha, beta, q = (
            np.sum([a * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.0)) for f in (0.1, 0.27, 0.4)], axis=0)
            for a in (0.06, 0.05, 0.004)
        )
        y = makes(alpha, beta) + rng.normal(0.0, 0.003, len(t))
        variables = {"alpha": alpha, "beta": beta, "q": q}
        found.append(Points(y=y, sigma=np.full(len(t), 0.003), variables=variables))
    return found


def bend(alpha: np.ndarray) -> np.ndarray:
    return -0.8 * np.maximum(alpha - 0.03, 0.0)


def test_a_bend_over_one_variable() -> None:
    found = shape_of("Cm", histories(lambda a, b: bend(a), 1), histories(lambda a, b: bend(a), 2, 1), Criteria())
    assert found is not None and (found.over, found.times) == ("alpha", "")
    off = found.y - bend(found.x)
    assert np.abs(off - off.mean()).max() < 0.006  # twice the noise of one node; a constant is no part of a shape
    assert np.median(np.abs(off - off.mean()) / found.std) < 3.0 and found.std.max() < 0.01
    assert "no cause" in found.sentence and plain(found)["times"] is None


def test_a_slope_that_depends_on_another_variable() -> None:
    """Cl = 30 alpha^2 beta."""

    def makes(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return 30.0 * a**2 * b

    found = shape_of("Cl", histories(makes, 3), histories(makes, 4, 1), Criteria())
    assert found is not None and (found.over, found.times) == ("alpha", "beta")
    off = np.abs(found.y - 30.0 * found.x**2) / np.maximum(found.std, 1e-12)
    assert np.median(off) < 2.0


@pytest.mark.parametrize("seed", range(10))
def test_noise_has_no_shape(seed: int) -> None:
    assert (
        shape_of("Cm", histories(lambda a, b: 0.0 * a, seed), histories(lambda a, b: 0.0 * a, 99, 1), Criteria())
        is None
    )


def test_a_shape_that_held_out_records_do_not_have_is_dropped() -> None:
    """The bend of the fitted records is the other way on the one that is held out."""
    assert (
        shape_of("Cm", histories(lambda a, b: bend(a), 1), histories(lambda a, b: -bend(a), 2, 1), Criteria()) is None
    )


def test_a_record_with_one_node_of_a_history_changes_no_shape() -> None:
    """Truth: the shape without a history in that record. In a flight of long records a short one has one node."""
    flight = prepare(aircraft_file(), records())
    fitted = fit(flight, (), flight.noise())
    (whole,) = missing_at(weigh(fitted), ["dCm"])
    first, second = NAMES
    history = {first: whole.history[first]}
    one_node = tuple(series[:1] for series in whole.history[second])
    without, short = (replace(whole, history=some) for some in (history, {**history, second: one_node}))
    (found,), (wanted,) = (shapes_of(fitted, fitted, [some]) for some in (short, without))
    assert (found.over, found.times, found.held_out) == (wanted.over, wanted.times, wanted.held_out)
    np.testing.assert_array_equal(found.y, wanted.y)
    assert shape_of("Cm", histories(lambda a, b: bend(a), 1), [], Criteria()) is None


def test_a_shape_flies_as_a_table_of_the_extended_file(tmp_path: Path) -> None:
    """Do 328 whose pitching moment bends above its trim: the file with the shapes, written and read again, flies as
    the aircraft with the bend, alone and times a rate."""
    level = trim(do328(), V=V_TRIM, altitude=3000.0)
    t = np.arange(0.0, 6.0, 0.04)
    channels = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    channels["delta_e"] = channels["delta_e"] - 0.03 * np.sin(2.0 * np.pi * 0.4 * t)
    record = Record(name="m1", t=t, channels=channels)
    x = level.alpha + np.linspace(-0.1, 0.3, 41)  # the bend is at one of them
    found = [
        Shape(coefficient="Cm", over="alpha", times=times, x=x, y=y, std=0.01 * np.ones(41), held_out=2.0)
        for times, y in (("", bend(x - level.alpha + 0.03)), ("q", -20.0 * np.maximum(x - level.alpha, 0.0)))
    ]

    def bent_moment(at):
        above = ca.fmax(at.alpha - level.alpha, 0.0)
        return {"Cm": -0.8 * above - 20.0 * above * at.q}

    with_shapes(do328(), found).write(tmp_path / "extended.toml")
    truth = replace(do328(), aerodynamics=bent_moment)
    plain, extended, bent = (
        simulate(aircraft_model(one), record, level.state).as_record("m1")["alpha"]
        for one in (do328(), Aircraft.read(tmp_path / "extended.toml"), truth)
    )
    assert np.abs(extended - bent).max() < 1e-3 * np.abs(bent - plain).max()
