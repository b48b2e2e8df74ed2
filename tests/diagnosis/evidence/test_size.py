"""What matters: sizes in units of the smallest that an engineer would call a fault."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.baseline import is_induced_drag
from casid.diagnosis.evidence.fingerprints import largest_change
from casid.diagnosis.evidence.size import meaningful_share
from casid.diagnosis.flight.evaluation import Work, evaluate
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import free_simulation
from casid.diagnosis.gates import is_possible
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.controls import actuator_lag, input_delay, rate_limit
from casid.model.causes.instruments import sensor_bias, sensor_lag, structural_mode
from casid.model.causes.loading import mass
from casid.model.effect import Effect
from problems.do328 import do328


@pytest.mark.parametrize(
    ("effect", "size", "known"),
    [
        (input_delay("delta_a"), 0.015, False),
        (input_delay("delta_a"), 0.025, True),
        (actuator_lag("delta_a"), 0.015, False),
        (actuator_lag("delta_a"), 0.025, True),
        (rate_limit("delta_a"), 0.50, False),
        (rate_limit("delta_a"), 0.40, True),
    ],
)
def test_a_surface_that_is_late_by_less_than_half_a_sample_may_be_in_time(
    effect: Effect, size: float, known: bool
) -> None:
    """At 25 Hz half a sample is 0.020 s; at 100 Hz 0.015 s are three times that. A limit holds back the quickest edge,
    of 0.6 rad/s, by as much as it takes to catch up."""
    shares = []
    for rate in (25.0, 100.0):
        flight = prepare(do328(), flights(seed=1, count=1, rate_hz=rate, surface_noise=0.0))
        base = fit(flight, [], flight.noise(), extent=(2, 0.5))
        shares.append(meaningful_share(base, Attached(effect=effect, values={"value": size})))
    assert (shares[0] >= 1.0) == known
    assert effect.kind == "rate_limit" or shares[1] >= 1.0


@pytest.mark.parametrize(("noise", "matters"), [(0.3, False), (0.005, True)])
def test_an_instrument_that_is_off_by_more_than_its_noise_matters(noise: float, matters: bool) -> None:
    """A speed that varies slowly is hardly changed, 0.7 % of its variation, by a lag of 0.03 s; but a precise reading
    shows it. (A bank angle that lagged by 0.08 s, 150 sigmas, was too small to matter.)"""
    flight = prepare(do328(), flights(seed=1, count=1, noise={**NOISE, "V": noise}))
    base = fit(flight, [], flight.noise(), extent=(2, 0.5))
    share = meaningful_share(base, Attached(effect=sensor_lag("V"), values={"value": 0.03}))
    assert (share >= 1.0) == matters


def test_a_bias_within_the_noise_of_its_reading_does_not_matter() -> None:
    """A cheap gyro whose noise is 0.3 deg/s may be off by as much; by 0.1 deg/s, which matters of others, it is."""
    bias, aircraft = sensor_bias("q"), do328()
    precise, cheap = (replace(aircraft, noise={**aircraft.noise, "q": sigma}) for sigma in (1e-4, 0.0052))
    assert bias.smallest_that_matters(precise) == pytest.approx(0.001745, rel=1e-3)
    assert bias.smallest_that_matters(cheap) == 0.0052


@pytest.mark.parametrize(("damping", "possible"), [(0.05, True), (0.2, False), (2.2, False)])
def test_a_structural_mode_is_lightly_damped(damping: float, possible: bool) -> None:
    """What does not ring is none: half gone after one cycle, it looks like a lag of the reading."""
    values = {"value": 0.015, "frequency_hz": 4.3, "damping": damping}
    assert is_possible(Attached(effect=structural_mode("p"), values=values)) == possible


def test_drag_that_lift_induces_is_no_fault() -> None:
    """Truth: CL_alpha^2 / (pi A e), by hand: 25 / (pi 9 0.5) = 1.77 for a lift slope of 5 and an aspect ratio of 9."""
    aircraft = SimpleNamespace(area=36.0, moment_length_pitch=2.0, derivatives={"CL_alpha": 5.0})
    flight = SimpleNamespace(aircraft=aircraft)
    fit = SimpleNamespace(flight=flight, derivatives={}, criteria=Criteria())
    polar = aero_term("CD", "alpha^2")
    found = [is_induced_drag(polar, value, fit) for value in (1.7, 1.8, -0.1)]  # pyright: ignore
    assert found == [True, False, False]
    assert not is_induced_drag(aero_term("CD", "beta^2"), 0.1, fit)  # pyright: ignore


@pytest.mark.parametrize(
    ("effect", "value"),
    [(mass(), 20.0), (input_delay("delta_e"), 0.01), (sensor_bias("alpha"), 1e-4), (aero_term("Cm", "alpha^2"), 0.05)],
    ids=lambda one: getattr(one, "kind", ""),
)
def test_the_change_of_readings_is_that_of_a_simulation(effect: Effect, value: float) -> None:
    """A filter that corrects its states by readings would see a part of it. The truth are two simulations, with and
    without the effect, from one initial state."""
    flight = prepare(do328(), flights(seed=1, count=2))
    base = fit(flight, [], flight.noise(), free="states")
    one = Attached(effect=effect, values={"value": value}, records=flight.names[:1])
    with_it = evaluate(Work(flight, [one], flight.noise(), "states"), [one], np.zeros(0), base.motion)
    change = free_simulation(with_it).output - free_simulation(base).output
    noise = np.array([flight.sigma[name] for name in flight.outputs])
    expected = np.sqrt(np.mean((change / noise) ** 2, axis=(0, 1), where=base.seen)).max() / flight.every**0.5
    assert largest_change(base, one) == pytest.approx(expected, rel=0.05)
    assert largest_change(base, one.with_values({"value": 2.0 * value})) == pytest.approx(2.0 * expected, rel=0.1)
