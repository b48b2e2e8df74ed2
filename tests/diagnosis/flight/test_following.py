"""What follows earlier inputs is no moving air. Truth: a loop in which a pilot answers coloured air, drawn here."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import coherence

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.noise import beyond_air, following

LENGTH = 3000


def flown(seed: int, late: int) -> tuple[SimpleNamespace, np.ndarray, np.ndarray]:
    """(fit, air, input) of a roll rate that answers an aileron, `late` samples behind it, and air with a memory; an
    autopilot answers the roll rate. The fit predicts the next sample from all before it, with an aileron in time."""
    rng = np.random.default_rng(seed)
    damping, power = rng.uniform(0.8, 0.95), rng.uniform(0.1, 0.3)
    memory, gain, most = rng.uniform(0.9, 0.98), rng.uniform(0.4, 0.8), rng.uniform(0.2, 0.4)
    gust, tests = rng.normal(size=LENGTH), most * rng.choice([-1.0, 0.0, 1.0], LENGTH // 25).repeat(25)
    air, p, aileron, white = np.zeros(LENGTH), np.zeros(LENGTH), np.zeros(LENGTH), np.zeros(LENGTH)
    for k in range(1, LENGTH):
        aileron[k - 1] = tests[k - 1] - gain * p[k - 1]
        air[k] = memory * air[k - 1] + 0.05 * gust[k]
        p[k] = damping * p[k - 1] + power * aileron[max(k - 1 - late, 0)] + air[k]
    seen_air = p[1:] - damping * p[:-1] - power * aileron[:-1]  # by a model in which the aileron is in time
    white[2:] = (seen_air[1:] - memory * seen_air[:-1]) / 0.05
    live = np.ones((LENGTH, 1), dtype=bool)
    fit = SimpleNamespace(
        criteria=Criteria(),
        noise=SimpleNamespace(coloured={"wind_y": (1.0, 2.0)}),
        batch=SimpleNamespace(live=live, U=np.stack([aileron, np.full(LENGTH, 1.2)], axis=-1)[:, None]),
        model=SimpleNamespace(inputs=("delta_a", "rho"), outputs=("p",)),
        white=white[:, None, None] / white.std(),
        seen=live[..., None],
    )
    return fit, air, aileron


@pytest.mark.parametrize("seed", range(25))
def test_air_that_an_autopilot_answers_follows_no_input(seed: int) -> None:
    """The air and the aileron are coherent; the innovations do not follow what the aileron did before."""
    fit, air, aileron = flown(seed, late=0)
    assert coherence(air, aileron, nperseg=256)[1][1:30].max() > 0.3
    found = following(fit)  # pyright: ignore
    assert found is not None and found.statistic < fit.criteria.missing
    assert beyond_air(fit) == 0.0  # pyright: ignore
    assert abs(found.statistic) < 5.0 * np.sqrt(2.0 * fit.criteria.numerics.samples_per_cycle)  # of chi-square


@pytest.mark.parametrize("seed", range(25))
def test_a_late_aileron_that_is_taken_for_air_follows_the_aileron(seed: int) -> None:
    fit, _, _ = flown(seed, late=5)
    found = following(fit)  # pyright: ignore
    assert found is not None and (found.output, found.input) == ("p", "delta_a")
    assert beyond_air(fit) == found.statistic > fit.criteria.missing  # pyright: ignore
    fit.noise.coloured = {}
    assert beyond_air(fit) == 0.0  # pyright: ignore


def test_inputs_that_rest_are_followed_by_nothing() -> None:
    fit, _, _ = flown(1, late=0)
    fit.batch.U = np.ones_like(fit.batch.U)
    assert following(fit) is None  # pyright: ignore
