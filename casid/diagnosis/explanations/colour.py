"""Colour that is left: how many independent readings the readings of a channel are worth, and evidence so tempered.

Innovations of a right model are white. On real flights what is left of a channel moves slowly, whatever is named, and
to count its samples as independent makes every probability 0 or 1. Slow histories of the model take some of that. Let
what they leave of a channel have the density d at low frequencies, in units of that of white noise of unit variance.
Then its readings are worth 1 / d as many independent ones, which is the power to which its likelihood is raised.
Assumed is that what is left has the same colour throughout, and that causes are slow against it.

What is fitted is slow and takes what is slow of the noise. The density is therefore power over what fitted sizes leave
free of it, cosine by cosine (one less leverage), from the lowest frequency on until enough is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from casid.diagnosis.explanations.explanation import Explanation, RecordColumns, WhitenedInnovations
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.score import (
    Sums,
    covariance,
    hold,
    levels_of,
    root_of,
    small_information,
    solved,
    with_priors,
)
from casid.diagnosis.explanations.search import Found, search
from casid.diagnosis.numerics import ScoreNumerics


def searched_in_colour(found: Found, channels: Sequence[np.ndarray]) -> tuple[Found, dict[int, float]]:
    """The search over again with the colour allowed for that its best explanation leaves, until that stays; and what
    the readings of each channel are worth. The same search where all channels are white.

    channels  per record (rows,) number of the channel of each row, -1 where nothing was read
    """
    every = sorted({int(c) for one in channels for c in np.unique(one)} - {-1})
    now, worths = found, dict.fromkeys(every, 1.0)
    numerics = found.priors.numerics
    for _ in range(numerics.colour_rounds):
        left, taken = left_by(found.sums, found.priors, now.explanations[0])
        of = {c: [e[at == c] for e, at in zip(left, channels, strict=True) if np.any(at == c)] for c in every}
        by = {c: [q[at == c] for q, at in zip(taken, channels, strict=True) if np.any(at == c)] for c in every}
        before, worths = worths, {c: worth(of[c], by[c], numerics) for c in every}
        worths = {c: w if w < found.priors.white else 1.0 for c, w in worths.items()}
        if all(abs(np.log(worths[c] / before[c])) < numerics.colour_stays for c in every):
            break
        weights = [np.array([worths.get(int(c), 1.0) for c in at]) for at in channels]
        now = search(tempered(found.innovations, weights), found.priors, found.explanations[0])
    return now, worths


def left_by(sums: Sums, priors: Priors, one: Explanation) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per record (rows,) what an explanation, and all that every explanation has, leave of the innovations; and (rows,
    sizes) what its sizes took of them: products of the rows of that are the hat matrix."""
    innovations, k = sums.innovations, len(sums.innovations.precision)
    held = hold(sums, priors, one.setting.level, one.unknown)
    common, match = with_priors(innovations, held)
    common[k:, k:] += small_information(innovations, dict(one.setting.scales))
    columns = [e.column for e in one.elements]
    scale = np.array([e.scale for e in one.elements])
    mean = np.array([innovations.causes[c].mean for c in columns])
    prior = np.diag(scale**-2.0) if len(columns) else np.zeros((0, 0))
    cross = held.cross[:, columns]
    whole = np.block([[common, cross], [cross.T, held.K[np.ix_(columns, columns)] + prior]])
    right = np.concatenate([match, held.z[columns] + (mean / scale**2 if len(columns) else mean)])
    L, unit = root_of(whole, priors.numerics.ridge)
    inverse = solved(L, unit, np.eye(len(whole)))
    sizes = inverse.T @ (inverse @ right)
    left, taken = [], []
    for r, record in enumerate(innovations.records):
        every = np.zeros((len(record.residual), len(sizes)))
        every[:, : sums.common] = np.hstack([record.nuisance, record.small])
        for i, c in enumerate(columns, start=sums.common):
            if r in innovations.causes[c].shape:
                every[:, i] = record.shapes[:, innovations.causes[c].shape[r]]
        y = record.residual - every @ sizes
        left.append(y - _followed(sums, priors, one, r, y))
        taken.append(every @ inverse.T)
    return left, taken


def _followed(sums: Sums, priors: Priors, one: Explanation, r: int, y: np.ndarray) -> np.ndarray:
    """What the histories of an explanation follow of what else it leaves in a record."""
    levels, record = levels_of(sums, priors, one.setting.level, one.unknown), sums.innovations.records[r]
    if not levels:
        return np.zeros(len(y))
    some = sums.nodes_of(r, list(levels))
    ports = [(p, sums.innovations.ports[p].matters) for p in levels]
    match = np.concatenate([matters * (record.histories[p].T @ record.in_steps(y)) for p, matters in ports])
    spreads = [np.sum([v**2 * covariance(record.nodes, tau) for v, tau in at], axis=0) for at in levels.values()]
    prior = block_diag(*[np.linalg.inv(one) for one in spreads])
    nodes = np.linalg.solve(sums.records[r].hh[np.ix_(some, some)] + prior, match)
    n = len(record.nodes)
    parts = [matters * (record.histories[p] @ nodes[i * n : (i + 1) * n]) for i, (p, matters) in enumerate(ports)]
    return record.in_rows(np.sum(parts, axis=0))


def worth(left: Sequence[np.ndarray], taken: Sequence[np.ndarray], numerics: ScoreNumerics) -> float:
    """Part of the readings of a channel that independent ones of unit variance would be as good as.

    left, taken  per stretch without gaps (n,) what is left, and (n, sizes) what was taken of it, as `left_by` has them
    """
    found = []
    for e, q in zip(left, taken, strict=True):
        k, n = min(len(e), numerics.colour_waves), len(e)
        waves = np.cos(np.pi / n * np.outer(np.arange(k), np.arange(n) + 0.5)) * np.sqrt(2.0 / n)
        waves[0] *= np.sqrt(0.5)
        free = 1.0 - np.sum((waves @ q) ** 2, axis=1)
        found.append(np.stack([np.arange(k) / n, (waves @ e) ** 2, np.clip(free, 0.0, 1.0)]))
    frequency, power, free = np.concatenate(found, axis=1)
    order = np.argsort(frequency, kind="stable")
    power, free = np.cumsum(power[order]), np.cumsum(free[order])
    enough = min(int(np.searchsorted(free, numerics.colour_free)), len(free) - 1)
    return float(min(1.0, free[enough] / max(power[enough], 1e-300)))


def tempered(innovations: WhitenedInnovations, weights: Sequence[np.ndarray]) -> WhitenedInnovations:
    """The question with the likelihood of every row raised to a power, `weights` per record (rows,), which does not
    change within a step of the histories."""
    records = []
    for record, weight in zip(innovations.records, weights, strict=True):
        by = np.sqrt(weight)[:, None]
        by_step = _of_steps(record, by)
        records.append(
            replace(
                record,
                residual=record.residual * by[:, 0],
                nuisance=record.nuisance * by,
                small=record.small * by,
                histories=tuple((h * by_step).astype(h.dtype) for h in record.histories),
                shapes=record.shapes * by,
            )
        )
    return replace(innovations, records=tuple(records))


def _of_steps(record: RecordColumns, by: np.ndarray) -> np.ndarray:
    """(steps, 1) of (rows, 1) that does not change within a step; zero of a step in which nothing was read."""
    of_ones = record.in_steps(np.ones(by.shape))
    return record.in_steps(by) / np.maximum(of_ones, 1e-300)
