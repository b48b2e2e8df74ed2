"""Compute what can be detected: by how many standard deviations a cause shows beside everything that may imitate it.

This is the measure of the search for causes, of what a diagnosis could not see, and of isolability before a flight.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.fingerprints import Fingerprint
from casid.diagnosis.evidence.screening import Candidate, Screen


def sigmas_shown(left: np.ndarray, whole: np.ndarray, criteria: Criteria) -> np.ndarray:
    """Standard deviations by which responses differ from what derivatives can reproduce; 0 for what they reproduce.

    `whole` and `left` are the squares of the whitened responses before and after the projection on all parameters.
    """
    return np.sqrt(np.where(left >= criteria.naming.approximate**2 * whole, left, 0.0))


def smallest_sizes(
    judge: Screen, prints: Iterable[Fingerprint], candidates: Iterable[Candidate], sigmas: float
) -> dict[str, float]:
    """Name -> smallest detectable size, at so many `sigmas`, of an effect that acts in all records.

    It is infinite if derivatives reproduce the effect at any size. For an event it is that at the best onset of its
    candidate. Terms of the aerodynamics are left out, and so are effects that are weaker for larger values, like a
    limit.
    """
    by_name = groupby(sorted(prints, key=lambda p: p.effect.name), key=lambda p: p.effect.name)
    sizes = {name: _smallest(judge, list(of), sigmas) for name, of in by_name}
    sizes |= {c.name: sigmas * c.std for c in candidates if c.attached.effect.timed and c.attached.effect.linear}
    return {name: float(size) for name, size in sizes.items() if size is not None}


def _smallest(judge: Screen, prints: Sequence[Fingerprint], sigmas: float) -> float | None:
    """Smallest detectable size of one effect, from the tried size and shape nearest to it; None if it has none."""
    effect = prints[0].effect
    if (
        effect.timed
        or effect.quasi_steady
        or effect.members
        or (not effect.linear and "value" not in effect.further.grid[0])
    ):
        return None
    everywhere = np.ones((1, len(prints[0].square)))
    tried = np.array([1.0 if effect.linear else abs(one.values["value"]) for one in prints])
    left = np.array([judge.projected([one], everywhere)[0] for one in prints])
    shown = sigmas_shown(left, np.array([one.square.sum() for one in prints]), judge.criteria)
    if not shown.any():
        return np.inf
    if not effect.linear and shown[np.argmax(tried)] < shown[np.argmin(tried)]:
        return None
    # Between the tried sizes the response is taken as proportional to the size.
    reached = np.array([size * sigmas / s if s > 0.0 else np.inf for size, s in zip(tried, shown, strict=True)])
    if effect.linear:
        return reached.min()
    nearest = reached[np.argmin(np.abs(np.log(reached / tried)))]
    return max(nearest, tried.min() / judge.criteria.data.outlying)  # below, a screening takes it for another
