"""Sizes of noise by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

Levels = Mapping[str, float]

_FARTHEST = 64  # steps of one size in one direction, before the other sizes are looked at


def most_likely_levels(
    start: Levels,
    bounds: Mapping[str, tuple[float, float]],
    deviance: Callable[[Levels], float],
    groups: Sequence[Sequence[str]],
    factors: Sequence[float],
    sweeps: int,
    gained: float,
) -> dict[str, float]:
    """Sizes by name at which a deviance is lowest, by coordinate ascent of the likelihood.

    Sizes whose change raised the deviance by more than the others have lowered it since are not tried again: those
    would have to lower it there by twice as much as here.

    groups   names whose sizes change together
    factors  steps, one after the other
    sweeps   largest number of rounds with each step
    gained   decrease of the deviance below which a round is the last one
    """
    levels = dict(start)
    lowest = deviance(start)
    for factor in factors:
        # of each group, the lower of the deviances to either side of its place, and the one there when they were found
        beside = [-math.inf] * len(groups)
        left = [0.0] * len(groups)
        for _ in range(sweeps):
            before = lowest
            for i, names in enumerate(groups):
                if beside[i] - left[i] > left[i] - lowest:
                    continue
                beside[i] = math.inf
                for times in (factor, 1.0 / factor):
                    for _ in range(
                        _FARTHEST
                    ):  # as far as it goes: otherwise the noise of a reading takes the place of a disturbance
                        here = {name: levels[name] for name in names}
                        moved = {name: min(max(here[name] * times, bounds[name][0]), bounds[name][1]) for name in names}
                        if moved == here:
                            break
                        found = deviance(levels | moved)
                        if not found < lowest:
                            beside[i] = min(beside[i], found)
                            break
                        beside[i] = lowest
                        levels = levels | moved
                        lowest = found
                left[i] = lowest
            if before - lowest < gained:
                break
    return levels
