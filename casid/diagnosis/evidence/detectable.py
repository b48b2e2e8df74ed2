"""The smallest sizes of causes that records would show: what an "adequate" is worth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from casid.diagnosis.evidence.fingerprints import Fingerprint
from casid.diagnosis.evidence.screening import Candidate, Screen


def smallest_sizes(
    judge: Screen, prints: Iterable[Fingerprint], candidates: Iterable[Candidate], sigmas: float
) -> dict[str, float]:
    """Name -> smallest size in all records that stands out by so many `sigmas`, aerodynamic terms apart; infinite where
    derivatives imitate it at any size.

    Of an effect that sets in at a time, at the best onset of its candidate. Left out are those that are the weaker the
    larger their value is, like a limit.
    """
    by_name = groupby(sorted(prints, key=lambda p: p.effect.name), key=lambda p: p.effect.name)
    sizes = {name: _smallest(judge, list(of), sigmas) for name, of in by_name}
    sizes |= {c.name: sigmas * c.std for c in candidates if c.attached.effect.timed and c.attached.effect.linear}
    return {name: float(size) for name, size in sizes.items() if size is not None}


def _smallest(judge: Screen, prints: Sequence[Fingerprint], sigmas: float) -> float | None:
    """Of one effect: of the tried sizes and shapes, by the one that is nearest to where it stands out."""
    effect = prints[0].effect
    if effect.timed or effect.quasi_steady or effect.members or (not effect.linear and "value" not in effect.grid[0]):
        return None
    everywhere = np.ones((1, len(prints[0].square)))
    tried = np.array([1.0 if effect.linear else abs(one.values["value"]) for one in prints])
    shown = np.array([_sigmas(judge, one, everywhere) for one in prints])
    if not shown.any():
        return np.inf
    if not effect.linear and shown[np.argmax(tried)] < shown[np.argmin(tried)]:
        return None
    # between sizes that were tried it is taken as growing in proportion
    reached = np.array([size * sigmas / s if s > 0.0 else np.inf for size, s in zip(tried, shown, strict=True)])
    if effect.linear:
        return reached.min()
    nearest = reached[np.argmin(np.abs(np.log(reached / tried)))]
    return max(nearest, judge.criteria.screening.smallest_size * tried.min())  # below, a screening takes it for another


def _sigmas(judge: Screen, one: Fingerprint, everywhere: np.ndarray) -> float:
    """By how many 1-sigmas the response to the size that was tried differs from what derivatives can imitate."""
    left, _, share = judge.projected([one], everywhere)
    return float(np.sqrt(left)) if share >= judge.criteria.screening.surviving else 0.0
