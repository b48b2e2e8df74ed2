"""Cramer-Rao and insensitivity per cent against the information matrix written out, and the order of dropping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from estimation_cases import START, short_period
from frequency_cases import flown, noisy

import casid as cs


@dataclass
class _Fit:
    values: dict[str, float]
    covariance: np.ndarray


def of_information(values: dict[str, float], information: np.ndarray) -> cs.Precision:
    return cs.precision(_Fit(values, np.linalg.inv(information)))


def test_per_cents_are_those_of_the_information_matrix() -> None:
    h = np.array([[400.0, 90.0], [90.0, 25.0]])
    found = of_information({"a": -2.0, "b": 5.0}, h).parameters
    determinant = 400.0 * 25.0 - 90.0**2
    assert found["a"].cramer_rao_percent == pytest.approx(100.0 * np.sqrt(25.0 / determinant) / 2.0)
    assert found["b"].cramer_rao_percent == pytest.approx(100.0 * np.sqrt(400.0 / determinant) / 5.0)
    assert found["a"].insensitivity_percent == pytest.approx(100.0 / 20.0 / 2.0)
    assert found["b"].insensitivity_percent == pytest.approx(100.0 / 5.0 / 5.0)


def test_the_most_insensitive_goes_first_then_the_most_correlated() -> None:
    """a and b are known 10 times worse together than alone; c hardly matters; d matters less."""
    h = np.diag([1e4, 1e4, 4.0, 25.0])
    h[0, 1] = h[1, 0] = 0.999 * 1e4
    found = of_information(dict.fromkeys("abcd", 1.0), h)
    assert found.drop[:2] == ("c", "d")
    assert len(found.drop) == 3 and found.drop[2] in "ab"  # without one of them the other is at 1 %
    assert "insensitive" in found.parameters["c"].remark
    assert "correlated" in found.parameters["a"].remark


def test_nothing_is_dropped_of_a_good_fit_and_unknown_is_said() -> None:
    assert of_information({"a": 1.0, "b": -1.0}, np.diag([1e4, 1e4])).drop == ()
    unknown = cs.precision(_Fit({"a": 1.0}, np.full((1, 1), np.nan)))
    assert unknown.parameters["a"].remark == "not determined by the data"
    held = cs.precision(_Fit({"a": 1.0, "b": 2.0}, np.diag([0.0, 0.01])))
    assert held.parameters["a"].insensitivity_percent == held.parameters["a"].cramer_rao_percent == 0.0
    assert held.parameters["b"].cramer_rao_percent == pytest.approx(5.0)


def test_it_takes_a_fit_in_time_and_its_table_has_every_parameter() -> None:
    record = noisy(flown(), {"alpha": 0.002, "q": 0.004}, np.random.default_rng(1))
    fit = cs.solve(cs.Problem(short_period(START), [record], free=["*"]))
    found = cs.precision(fit)
    for name, one in found.parameters.items():
        assert one.cramer_rao_percent == pytest.approx(100.0 * fit[name].std_cramer_rao / abs(fit[name].value))
        assert one.insensitivity_percent <= one.cramer_rao_percent * (1.0 + 1e-9)
        assert name in str(found)
