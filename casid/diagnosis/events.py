"""Causes that set in at a time: when, with which uncertainty, and sets of coefficients that switch together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.evidence import Evidence
from casid.diagnosis.fit import Fit
from casid.diagnosis.hypothesis import Attached
from casid.diagnosis.screening import ONSET_STEP, Candidate, Fingerprint, Screen, fingerprints
from casid.model.causes import configuration_change
from casid.model.path import coefficient_names

_FINE = 0.1  # s
_DROP_95 = 3.841  # chi-square, one degree of freedom
_MEMBER = 0.04  # a coefficient belongs to the set when its own statistic exceeds this share of the largest


def refine_onsets(evidence: Evidence, attached: Attached) -> tuple[Attached, dict[str, tuple[float, float]]]:
    """The attached effect with each onset moved to the peak of its profile likelihood, and 95 % intervals [s].

    The profile is that of the score at `base`, which does not have the effect; the other records' onsets stay.
    """
    effect = attached.effect
    further = {k: v for k, v in attached.values.items() if k != "value"}
    base = evidence.fit
    judge, names = Screen(evidence), list(base.batch.names)
    onsets, intervals = dict(attached.onsets), {}
    for record, onset in attached.onsets.items():
        r = names.index(record)
        first, last = base.flight.records[r].t[0], base.flight.records[r].t[-1]
        times = np.arange(max(onset - ONSET_STEP, first + _FINE), min(onset + ONSET_STEP, last - _FINE), _FINE)
        prints = _at(evidence, attached, further, times - first)
        keep = np.zeros((1, len(names)))
        keep[0, r] = 1.0
        profile = np.array([judge.score([p], keep)[0] for p in prints])
        onsets[record] = float(times[np.argmax(profile)])
        inside = times[profile > profile.max() - _DROP_95]
        intervals[record] = (float(inside.min() - _FINE), float(inside.max() + _FINE))
    return replace(attached, onsets=onsets), intervals if effect.timed else {}


def _at(evidence: Evidence, attached: Attached, further: dict[str, float], times: np.ndarray) -> list[Fingerprint]:
    """Fingerprints of the first coefficient or the effect itself at the given onsets."""
    effect = replace(attached.effect, grid=(further,))
    if effect.kind == "configuration_change":
        effect = replace(configuration_change(effect.target.split("+")[0]), grid=({},))
    return fingerprints(evidence, [effect], times)


def configuration_changes(evidence: Evidence) -> list[Candidate]:
    """Sets of coefficients that switch together: the best onset in each record, then the records that share it."""
    base = evidence.fit
    coefficients = coefficient_names(base.flight.aircraft.force_axes)
    judge, names, R = Screen(evidence), base.batch.names, len(base.batch.names)
    prints: dict[str, list[Fingerprint]] = {}
    for one in fingerprints(evidence, [configuration_change(c) for c in coefficients]):
        prints.setdefault(one.effect.target, []).append(one)
    found = []
    for r in range(R):
        keep = np.zeros((1, R))
        keep[0, r] = 1.0
        scores = {c: np.array([judge.score([p], keep)[:2] for p in row]) for c, row in prints.items()}
        total = sum(row[:, 0] for row in scores.values())
        at = int(np.argmax(total))
        table = {c: (float(row[at, 0]), float(row[at, 1])) for c, row in scores.items()}
        found.append((float(total[at]), prints[coefficients[0]][at].onset or 0.0, table))
    order = sorted(range(R), key=lambda r: -found[r][0])
    tries = float(len(prints[coefficients[0]])) * R
    candidates = []
    for chosen in [order[: k + 1] for k in range(R)]:
        pooled = {c: sum(found[r][2][c][0] for r in chosen) for c in coefficients}
        largest = max(pooled.values())
        members = sorted((c for c in coefficients if pooled[c] > _MEMBER * largest), key=lambda c: -pooled[c])
        sizes = {c: float(np.mean([found[r][2][c][1] for r in chosen])) for c in members}
        # single scores overlap: the largest one is certain, the refit finds what the set gains
        statistic, dof = largest, len(members)
        values = {("value" if c == members[0] else c): sizes[c] for c in members}
        starts = {names[r]: float(base.flight.records[r].t[0] + found[r][1]) for r in chosen}
        attached = Attached(effect=configuration_change("+".join(members)), values=values, onsets=starts)
        net = statistic - dof * judge.price - 2.0 * len(chosen) * np.log(tries)
        candidates.append(
            Candidate(
                attached=attached, statistic=statistic, net=net, dof=dof, value=sizes[members[0]],
                std=abs(sizes[members[0]]) / max(largest, 1e-9) ** 0.5, surviving=1.0, tries=tries ** len(chosen),
            )
        )  # fmt: skip
    return sorted(candidates, key=lambda c: -c.net)[:2]


def weak_members(fit: Fit, attached: Attached) -> Sequence[str]:
    """Coefficients of a fitted configuration change that are not significant (below 4 sigma)."""
    names = attached.effect.target.split("+")
    slots = {c: attached.name + ("" if c == names[0] else f".{c}") for c in names}
    return [c for c, slot in slots.items() if abs(fit[slot]) < 4.0 * fit.std(slot)]
