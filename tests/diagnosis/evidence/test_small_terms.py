"""Small structural errors: marginalised as functions, one scale a coefficient; what they are functions of."""

import itertools

import numpy as np
import pytest
from diagnosis_flights import flights, rough_file

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import most_likely_scales, small_terms
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model import operators
from casid.model.causes.aerodynamics import aero_term, configuration_change
from casid.model.causes.controls import actuator_lag
from problems.do328 import do328

_SCALES = (1.0, 2.0, 4.0)
_OWNERS = ("CL", "CL", "CL", "Cm", "Cm", "Cm")


def _problem(rng: np.random.Generator, scales: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(columns, residual, alike) of 60 samples with small terms of known scales."""
    columns = 3.0 * rng.standard_normal((60, 6))
    columns[:, 2] = columns[:, 0] + 0.1 * columns[:, 2]  # nearly the same function
    alike = np.zeros((6, 6))
    for own in (slice(0, 3), slice(3, 6)):
        block = columns[:, own].T @ columns[:, own]
        size = np.sqrt(np.diag(block))
        alike[own, own] = block / np.outer(size, size)
    values = np.linalg.cholesky(np.linalg.inv(alike)) @ rng.standard_normal(6) * np.repeat(scales, 3)
    return columns, columns @ values + rng.standard_normal(60), alike


@pytest.mark.parametrize("seed", range(4))
def test_scales_have_the_largest_likelihood_of_the_dense_gaussian(seed: int) -> None:
    """Truth: the density of the residual itself, N(0, 1 + J K^-1 J'), for every pair of scales."""
    columns, residual, alike = _problem(np.random.default_rng(seed), (1.0, 4.0))
    found = most_likely_scales(columns.T @ columns, columns.T @ residual, alike, _OWNERS, _SCALES)

    def deviance(pair: tuple[float, float]) -> float:
        scale = np.repeat(pair, 3)
        covariance = np.eye(60) + columns @ (np.linalg.inv(alike) * np.outer(scale, scale)) @ columns.T
        return float(residual @ np.linalg.solve(covariance, residual) + np.linalg.slogdet(covariance)[1])

    assert (found["CL"], found["Cm"]) == min(itertools.product(_SCALES, repeat=2), key=deviance)


def test_scales_do_not_depend_on_how_the_terms_are_written() -> None:
    """Symmetry: other terms of each coefficient that span the same functions say the same."""
    rng = np.random.default_rng(5)
    columns, residual, alike = _problem(rng, (2.0, 1.0))
    other = np.zeros((6, 6))
    other[:3, :3], other[3:, 3:] = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    written = columns @ other
    first = most_likely_scales(columns.T @ columns, columns.T @ residual, alike, _OWNERS, _SCALES)
    second = most_likely_scales(written.T @ written, written.T @ residual, other.T @ alike @ other, _OWNERS, _SCALES)
    assert first == second


def test_terms_are_those_that_symmetry_allows_and_the_model_lacks() -> None:
    flight = prepare(do328(), flights(seed=1, count=1))
    bend = Attached(effect=aero_term("Cm", "alpha^2"), values={"value": 0.1})
    names = small_terms(fit(flight, [bend], flight.noise(), extent=(1, 0.5))).names
    assert ("Cm", "alpha^2") not in names
    assert ("Cm", "alpha") not in names
    assert {("Cm", "alpha^3"), ("Cm", "beta^2"), ("Cl", "alpha*beta"), ("CL", "alphadot")} <= set(names)
    assert not {("Cm", "alpha*beta"), ("Cl", "alpha^2")} & set(names)


def test_terms_see_the_surface_as_the_air_does() -> None:
    """Truth: the recorded surface behind the lag, and not the record, by the operator itself."""
    flight = prepare(do328(), flights(seed=2, count=1))
    late = Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})
    fitted = fit(flight, [late], flight.noise(), extent=(3, 0.5))
    recorded, seen = fitted.known["delta_e"][:, 0], fitted.regressors["delta_e"][:, 0]
    behind = operators.lag(flight.records[0].t, recorded, fitted["actuator_lag(delta_e)"])
    assert np.abs(seen - behind).max() < 1e-9
    assert np.abs(recorded - behind).max() > 100.0 * np.abs(seen - behind).max()


def test_an_event_that_takes_longer_keeps_its_middle() -> None:
    flap = Attached(effect=configuration_change("CL"), values={"value": 0.1, "duration": 1.0}, onsets={"m1": 9.6})
    longer = flap.with_values({"duration": 2.4})
    assert longer.onsets["m1"] + 1.2 == pytest.approx(9.6 + 0.5)
    assert flap.with_values({"value": 0.2}).onsets == flap.onsets


@pytest.mark.slow
def test_a_nonlinear_lift_curve_hides_no_term_of_the_pitching_moment() -> None:
    """Lift nonlinear by more than is usual, in a way that is too small to matter, and 8 % of Cm from r^2."""
    bends = [("CL", "alpha^2", 8.0), ("CL", "beta^2", -1.4), ("CL", "delta_e^2", 5.0)]
    hidden = [Attached(effect=aero_term(c, term), values={"value": value}) for c, term, value in bends]
    hidden.append(Attached(effect=aero_term("Cm", "r^2"), values={"value": -33.0}))
    found = diagnose(rough_file(), flights(hidden, seed=11, count=3))
    assert [(c.kind, c.target, c.term) for c in found.causes] == [("aero_term", "Cm", "r^2")], str(found)
