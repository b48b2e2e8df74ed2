"""The smallest sizes that records would show. Truth: what a fit finds of effects of that size, and what it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights

from casid.diagnosis.evidence.detectable import smallest_sizes
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.screening import Screen, rank
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.air import gust
from casid.model.causes.controls import rate_limit
from casid.model.causes.instruments import sensor_bias, sensor_delay
from casid.model.causes.recording import thrust_scale
from problems.do328 import do328

SIGMAS = 5.6
OFFERED = [sensor_delay("q"), sensor_bias("q"), thrust_scale(), rate_limit("delta_e"), gust("z")]


def judged(*hidden: Attached) -> tuple[Screen, list, list]:
    noise = {name: 8.0 * sigma for name, sigma in NOISE.items()}  # so that a delay of some sizes does not show
    flight = prepare(do328(), flights(list(hidden), seed=11, count=2, noise=noise))
    judge = Screen(weigh(fit(flight, (), flight.noise()), discrepancy=False))
    prints = fingerprints(judge.evidence, OFFERED)
    return judge, prints, rank(judge, prints)


@pytest.mark.parametrize("effect", [sensor_delay("q"), sensor_bias("q")], ids=lambda e: e.kind)
def test_an_effect_of_that_size_stands_out_by_as_many_sigmas(effect) -> None:
    """Hidden with the smallest size, it gains the square of the sigmas, give or take the noise of a unit normal."""
    size = smallest_sizes(*judged(), SIGMAS)[effect.name]
    _, _, ranked = judged(Attached(effect=effect, values={"value": size}))
    (found,) = [c for c in ranked if c.name == effect.name]
    assert np.sqrt(found.statistic) == pytest.approx(SIGMAS, abs=2.0)


def test_what_derivatives_imitate_shows_at_no_plausible_size() -> None:
    """A thrust that hardly moves is a level of drag. A limit is left out: the lower it is, the more of it shows."""
    sizes = smallest_sizes(*judged(), SIGMAS)
    assert sizes["thrust_scale"] > thrust_scale().size.limit
    assert rate_limit("delta_e").name not in sizes
    assert 0.0 < sizes[gust("z").name] < 10.0
