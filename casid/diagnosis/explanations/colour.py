"""Colour that is left: how many independent readings the readings of a channel are worth, and evidence so tempered.

Innovations of a right model are white. On real flights what is left of a channel moves slowly, whatever is named, and
to count its samples as independent makes every probability 0 or 1. Slow histories of the model take some of that. Of
what they leave, a channel whose residual has variance s and integrated correlation T = 1 + 2 (r1 + r2 + ...) tells a
slow cause as much as 1 / (s T) of its readings would if they were independent: the power to which its likelihood is
raised. Assumed is that what is left has the same colour throughout, and that causes are slow beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from casid.diagnosis.explanations.explanation import Explanation, Innovations, RecordColumns
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
        spent = {c: sum(float(h[at == c].sum()) for h, at in zip(taken, channels, strict=True)) for c in every}
        before, worths = worths, {c: worth(of[c], numerics.longest_lag, spent[c]) for c in every}
        worths = {c: w if w < found.priors.white else 1.0 for c, w in worths.items()}
        if all(abs(np.log(worths[c] / before[c])) < numerics.colour_stays for c in every):
            break
        weights = [np.array([worths.get(int(c), 1.0) for c in at]) for at in channels]
        now = search(tempered(found.asked, weights), found.priors, found.explanations[0])
    return now, worths


def left_by(
    sums: Sums, priors: Priors, one: Explanation
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per record (rows,) what an explanation, and all that every explanation has, leave of the innovations; and what its
    fitted sizes took of each row: the leverages, which add up to the number of sizes."""
    asked, k = sums.asked, len(sums.asked.precision)
    held = hold(sums, priors, one.setting.level, one.unknown)
    common, match = with_priors(asked, held)
    common[k:, k:] += small_information(asked, dict(one.setting.scales))
    columns = [e.column for e in one.elements]
    scale = np.array([e.scale for e in one.elements])
    mean = np.array([asked.causes[c].mean for c in columns])
    prior = np.diag(scale**-2.0) if len(columns) else np.zeros((0, 0))
    cross = held.cross[:, columns]
    whole = np.block([[common, cross], [cross.T, held.K[np.ix_(columns, columns)] + prior]])
    right = np.concatenate([match, held.z[columns] + (mean / scale**2 if len(columns) else mean)])
    L, unit = root_of(whole)
    inverse = solved(L, unit, np.eye(len(whole)))
    sizes = inverse.T @ (inverse @ right)
    left, taken = [], []
    for r, record in enumerate(asked.records):
        every = np.zeros((len(record.residual), len(sizes)))
        every[:, : sums.common] = np.hstack([record.nuisance, record.small])
        for i, c in enumerate(columns, start=sums.common):
            if r in asked.causes[c].shape:
                every[:, i] = record.shapes[:, asked.causes[c].shape[r]]
        y = record.residual - every @ sizes
        left.append(y - _followed(sums, priors, one, r, y))
        taken.append(np.sum((every @ inverse.T) ** 2, axis=1))
    return left, taken


def _followed(sums: Sums, priors: Priors, one: Explanation, r: int, y: np.ndarray) -> np.ndarray:
    """What the histories of an explanation follow of what else it leaves in a record."""
    levels, record = levels_of(sums, priors, one.setting.level, one.unknown), sums.asked.records[r]
    if not levels:
        return np.zeros(len(y))
    some = sums.nodes_of(r, list(levels))
    ports = [(p, sums.asked.ports[p].matters) for p in levels]
    match = np.concatenate([matters * (record.histories[p].T @ record.in_steps(y)) for p, matters in ports])
    spreads = [np.sum([v**2 * covariance(record.nodes, tau) for v, tau in at], axis=0) for at in levels.values()]
    prior = block_diag(*[np.linalg.inv(one) for one in spreads])
    nodes = np.linalg.solve(sums.records[r].hh[np.ix_(some, some)] + prior, match)
    n = len(record.nodes)
    parts = [matters * (record.histories[p] @ nodes[i * n : (i + 1) * n]) for i, (p, matters) in enumerate(ports)]
    return record.in_rows(np.sum(parts, axis=0))


def worth(left: Sequence[np.ndarray], longest: float, spent: float = 0.0) -> float:
    """Part of the readings of a channel, in stretches without gaps, that independent ones would be as good as.

    spent  how many of these the fitted sizes took. They are slow and take what is slow: of w n independent readings
           w n - spent are left to tell of it, so that what is left looks by n w / (n w - spent) too good
    """
    square, T = float(np.mean(np.concatenate(left) ** 2)), 1.0
    energy = sum(float(e @ e) for e in left)
    for lag in range(1, max(2, int(longest * max(map(len, left))))):
        correlation = sum(float(e[lag:] @ e[:-lag]) for e in left if len(e) > lag) / max(energy, 1e-300)
        if correlation <= 0.0:
            break
        T += 2.0 * correlation
    looks, n = 1.0 / max(square * T, 1e-300), sum(map(len, left))
    # w = looks (1 - spent / (n w)); where no root is left, all that could be told is spent
    root = max(1.0 - 4.0 * spent / (n * looks), 0.0)
    return float(min(1.0, 0.5 * looks * (1.0 + np.sqrt(root))))


def tempered(asked: Innovations, weights: Sequence[np.ndarray]) -> Innovations:
    """The question with the likelihood of every row raised to a power, `weights` per record (rows,), which does not
    change within a step of the histories."""
    records = []
    for record, weight in zip(asked.records, weights, strict=True):
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
    return replace(asked, records=tuple(records))


def _of_steps(record: RecordColumns, by: np.ndarray) -> np.ndarray:
    """(steps, 1) of (rows, 1) that does not change within a step; zero of a step in which nothing was read."""
    of_ones = record.in_steps(np.ones(by.shape))
    return record.in_steps(by) / np.maximum(of_ones, 1e-300)
