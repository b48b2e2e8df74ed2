"""Sizes of noise: a deviance whose lowest point is known, and how often it is asked."""

from __future__ import annotations

import numpy as np
import pytest

from casid.filtering.noise_levels import most_likely_levels


@pytest.mark.parametrize("coupling", [0.0, 0.4])
def test_the_lowest_deviance_is_found_and_sizes_that_cannot_lower_it_are_left(coupling: float):
    factor, names = 1.5, [f"s{i}" for i in range(8)]
    steps = np.array([3, 0, 0, -2, 0, 0, 0, 1])  # the lowest point, in steps from the start
    bend = np.eye(8) + coupling * (np.eye(8, k=3) + np.eye(8, k=-3))
    asked: list[dict[str, float]] = []

    def deviance(levels):
        asked.append(dict(levels))
        off = np.log([levels[name] for name in names]) / np.log(factor) - steps
        return 1e3 * off @ bend @ off

    bounds = dict.fromkeys(names, (1e-3, 1e3))
    found = most_likely_levels(
        dict.fromkeys(names, 1.0), bounds, deviance, [(name,) for name in names], [factor], sweeps=6, gained=2.0
    )
    assert [found[name] for name in names] == pytest.approx(factor ** steps.astype(float))
    if not coupling:  # a round to either side of each size, the way, and no size again that nothing can move
        again = 2 * sum(1e3 * float(np.sum(steps[i + 1 :] ** 2)) >= 1e3 for i in range(len(names)))
        assert len(asked) == 1 + 2 * len(names) + np.abs(steps).sum() + again
