"""The yardstick of the diagnosis. Truth: what was put into the flights, and the formula of an autoregression."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import casid as cs
from casid.model.effects import effect_of
from problems.blind.greedy import correlation_length, search
from problems.do328 import do328
from problems.jsbsim.flight import NOISE

T = 0.04 * np.arange(300)


def flights(effects: tuple[cs.EffectValue, ...]) -> list[cs.Record]:
    """Four records of the Do 328 with steps of all surfaces and noise of the readings."""
    start = cs.trim(do328(), V=144.0, thrust=10e3)
    model = cs.aircraft_model(do328().with_effects(effects))
    rng = np.random.default_rng(5)
    found = []
    for i in range(4):
        channels = {name: np.full(len(T), value) for name, value in start.inputs.items()}
        for j, surface in enumerate(("delta_e", "delta_a", "delta_r")):
            steps = np.sign(np.sin(2.0 * np.pi * (0.35 + 0.12 * j) * T + 0.7 * i + j)) * (T > 1.0) * (T < 9.0)
            channels[surface] = channels[surface] + 0.03 * np.convolve(steps, np.ones(5) / 5.0, mode="same")
        still = cs.simulate(
            cs.aircraft_model(do328()), cs.Record(name=f"m{i + 1}", t=T, channels=channels), start.state
        )
        read = cs.simulate(model, still.as_record(), start.state).as_record()
        noise = {name: NOISE[name] * rng.standard_normal(len(T)) for name in model.outputs}
        found.append(still.record.with_channels(**{name: read[name] + error for name, error in noise.items()}))
    return found


@pytest.mark.slow
def test_a_large_lag_is_found_and_nothing_else() -> None:
    lag = cs.EffectValue(kind="actuator_lag", target="delta_e", value=0.2)
    found = search(do328(), flights((lag,)))
    assert [[effect_of(one).name for one, _ in told] for told in found] == [["actuator_lag(delta_e)"]]


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is() -> None:
    assert search(do328(), flights(())) == []


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_correlation_length_of_an_autoregression(rho: float) -> None:
    """(1 + rho) / (1 - rho), to the part of it that autocorrelations below 0.05 have."""
    noise = np.random.default_rng(1).standard_normal((4, 5000))
    left = [np.asarray(lfilter([1.0], [1.0, -rho], one)).reshape(-1, 1) for one in noise]
    assert correlation_length(left)[0] == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.15)
