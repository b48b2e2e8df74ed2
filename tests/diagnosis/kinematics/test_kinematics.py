"""Kinematics judge a lever arm by the angular acceleration that they find themselves, from noisy rates."""

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights

from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import kinematics
from casid.model.causes import accelerometer_position
from problems.do328 import do328

_LEVER = 2.0  # m
_NOISY = {name: 4.0 * s if name in "pqr" else s for name, s in NOISE.items()}


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_lever_arm_is_not_underestimated_by_the_noise_of_the_rates(
    axis: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truth: 2 m. With angular accelerations far freer than they are, their noise makes it less than 80 % of that."""
    hidden = Attached(effect=accelerometer_position(axis), values={"value": _LEVER})
    flight = prepare(do328(), flights([hidden], seed=5, count=2, noise=_NOISY))

    def found() -> tuple[float, float]:
        start = [hidden.with_values({"value": 0.0})]
        fitted = kinematics.reconstruct(flight, start)
        fitted = fit(flight, start, fitted.noise, fitted, free="effects", iterations=15, tolerance=0.1)
        return fitted[hidden.name], fitted.std(hidden.name)

    value, std = found()
    assert abs(value - _LEVER) < 3.0 * std
    assert std < 0.2 * _LEVER
    monkeypatch.setattr(kinematics, "_angular_acceleration", lambda *_: 20.0)
    assert found()[0] < 0.8 * _LEVER


def test_a_free_angular_acceleration_is_as_large_as_the_true_one() -> None:
    """Truth: the derivative of a noiseless rate, its root mean square, within the factor for peaks."""
    quiet = {name: 1e-3 * s if name in "pqr" else s for name, s in NOISE.items()}
    record = flights(seed=6, count=1, noise=quiet)
    true = float(np.std(np.gradient(record[0]["p"], record[0].t)))
    for noise in (quiet, _NOISY):
        flight = prepare(do328(), flights(seed=6, count=1, noise=noise))
        assert kinematics._angular_acceleration(flight, "p", flight.criteria.kinematics) == pytest.approx(
            2.0 * true, rel=0.3
        )
