"""What gains are worth where a model leaves more than noise, or slower: 1000 readings may count for 20.

Of a right model the whitened residuals are white, and a gain is a drop of 2 ln L. What a real aircraft has beside any
model stays in them for seconds. Along a direction of the readings it then adds up to a variance larger than one, by a
factor that stretches of record show, as for the intervals of values (`evidence.scatter`). A difference of gains counts
for as much less (Royall and Tsou 2003, robust adjustment of a likelihood; of two causes, along what they differ in).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.naming.comparing import equivalents_of, ranked_behind
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.naming.round import Round, Trial


def tempered(naming: Naming) -> Naming:
    """The naming with the gains of its named rounds counted beside what its last fit leaves, and what is equivalent
    by that."""
    left = _Left(naming.evidence)
    rounds = tuple(_tempered(one, left, naming.criteria) if one.named else one for one in naming.rounds)
    return replace(naming, rounds=rounds)


def _tempered(round_: Round, left: _Left, criteria: Criteria) -> Round:
    best = replace(round_.leader, inflation=left.inflation(_response(round_.leader)))
    rivals = [replace(one, inflation=left.inflation(_difference(round_.leader, one))) for one in round_.rivals]
    earlier = {one.effect.key for one in round_.equivalents}
    found = equivalents_of(best, [best, *rivals], criteria)
    kept = [one for one in rivals if one.effect.key in earlier and one not in found]
    ranked = ranked_behind(best, rivals, criteria)
    return replace(round_, trials=(best, *rivals), equivalents=(*found, *kept), ranked=ranked)


def _response(trial: Trial) -> np.ndarray:
    """What it explains, whitened: as long as the root of its gain."""
    length = float(np.linalg.norm(trial.fingerprint))
    return trial.fingerprint * (np.sqrt(max(trial.gain.total, 0.0)) / max(length, 1e-300))


def _difference(one: Trial, other: Trial) -> np.ndarray:
    """What one of two causes explains otherwise than the other."""
    a, b = _response(one), _response(other)
    return a - np.copysign(1.0, a @ b) * b if a.size == b.size else np.zeros(0)


class _Left:
    """What a fit leaves of the readings, its small terms fitted too, by stretches of record."""

    def __init__(self, evidence: Evidence) -> None:
        self._left = evidence.left
        self._first: Sequence[np.ndarray] = [
            np.arange(0, len(self._left), max(1, round(evidence.criteria.structure.stretch / record.dt)))
            for record in evidence.fit.flight.records
        ]

    def inflation(self, direction: np.ndarray) -> float:
        """Variance of what is left along a direction of the readings, where white noise has one; one at least."""
        square = float(direction @ direction)
        if direction.size != self._left.size or square == 0.0:
            return 1.0
        along = np.einsum("nrc,nrc->nr", direction.reshape(self._left.shape), self._left)
        sums = [np.add.reduceat(along[:, r], first) for r, first in enumerate(self._first)]
        return max(float(np.sum(np.concatenate(sums) ** 2)) / square, 1.0)
