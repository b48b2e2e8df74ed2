"""The search along a step."""

from __future__ import annotations

import numpy as np
import pytest

from casid.estimation.solvers.search import rises_from_the_start


@pytest.mark.parametrize("seed", range(20))
def test_along_a_parabola_its_slope_at_the_beginning_decides(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slope, bend = rng.normal(size=2), rng.uniform(0.0, 2.0, 2)
    long, short = 1.0, rng.uniform(0.1, 0.9)
    refused = [(length, slope * length + bend * length**2) for length in (long, short)]
    assert rises_from_the_start(refused) == np.all(slope > 0.0)


def test_where_it_rises_ever_less_a_shorter_part_may_decrease_it() -> None:
    """A dip before a plateau: at 1 and at 0.4 it is higher than at the beginning, and lower at 0.02."""

    def square(length: float) -> np.ndarray:
        return np.array([1.0 - np.exp(-((length - 0.02) ** 2) / 0.01) - (1.0 - np.exp(-0.04))])

    assert square(1.0) > 0.0 and square(0.4) > 0.0 and square(0.02) < 0.0
    assert not rises_from_the_start([(1.0, square(1.0)), (0.4, square(0.4))])
    assert not rises_from_the_start([(1.0, square(1.0))])
