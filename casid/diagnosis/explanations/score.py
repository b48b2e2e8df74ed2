"""The score: marginal likelihoods of explanations, from one Gram matrix of whitened columns.

Noise and priors are Gaussian, so that an explanation is a choice of prior precisions over columns. Histories, nuisance
and small terms are eliminated first (`background`); S is the covariance of all these. Of the causes' columns F then
K = F' S^-1 F and z = F' S^-1 y remain. Given what is in an explanation already,

    a cause with amplitude N(mu, s^2)   adds 1/2 [(s^2 z^2 + 2 z mu - K mu^2) / (1 + s^2 K) - ln(1 + s^2 K)]
    an unknown history of level v       adds 1/2 [z' (1/v^2 + K)^-1 z - ln det(1 + v^2 K)]

to the log evidence, the second for a block of nodes in the eigenbasis of its prior, and each is a low-rank change of K.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, get_blas_funcs, solve_triangular
from scipy.special import ndtr

from casid.diagnosis.explanations.explanation import Entrance, RecordColumns, Setting, Unknown, WhitenedInnovations
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.numerics import ScoreNumerics


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordSums:
    """Products of the columns of one record: h of histories (all ports), x of nuisance, small terms and shapes."""

    hh: np.ndarray
    hx: np.ndarray
    hy: np.ndarray
    xx: np.ndarray
    xy: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Sums:
    """All that the score needs of the innovations. `square` y'y; `common` number of nuisance and small terms; `picked`
    per record (causes,) column of x of each, -1 where it has none."""

    innovations: WhitenedInnovations
    records: tuple[RecordSums, ...]
    square: float
    common: int
    picked: tuple[np.ndarray, ...]

    @cached_property
    def port_number(self) -> dict[str, int]:
        return {port.name: i for i, port in enumerate(self.innovations.ports)}

    def nodes_of(self, record: int, ports: Sequence[int]) -> np.ndarray:
        """Rows of h that belong to these ports."""
        n = len(self.innovations.records[record].nodes)
        return np.concatenate([np.arange(p * n, (p + 1) * n) for p in ports])


def sums_of(innovations: WhitenedInnovations, numerics: ScoreNumerics) -> Sums:
    """The normal equations of everything that could be in the innovations."""
    records = tuple(_record_sums(innovations, one, numerics) for one in innovations.records)
    common = len(innovations.precision) + len(innovations.owners)
    picked = tuple(
        np.array([common + cause.shape[r] if r in cause.shape else -1 for cause in innovations.causes], dtype=int)
        for r in range(len(records))
    )
    square = float(sum(one.residual @ one.residual for one in innovations.records))
    return Sums(innovations=innovations, records=records, square=square, common=common, picked=picked)


def _record_sums(innovations: WhitenedInnovations, record: RecordColumns, numerics: ScoreNumerics) -> RecordSums:
    n = len(record.nodes) * len(innovations.ports)
    X = np.column_stack([record.nuisance, record.small, record.shapes, record.residual])
    square = _gram(X)
    hh, hx = np.zeros((n, n)), np.zeros((n, X.shape[1]))
    unit = np.repeat([port.matters for port in innovations.ports], len(record.nodes))
    largest = [np.abs(h).max(axis=0, initial=0.0) for h in record.histories]
    gone = numerics.died_away * (np.concatenate(largest) if largest else np.zeros(0)) * unit
    for first in range(0, len(X) if n else 0, numerics.rows):
        rows = slice(first, first + numerics.rows)
        h = np.concatenate([one[rows] for one in record.histories], axis=1).astype(float) * unit
        alive = np.flatnonzero(np.abs(h).max(axis=0, initial=0.0) > gone)
        if not len(alive):
            continue
        some = h[:, alive]
        hh[np.ix_(alive, alive)] += _gram(some)
        hx[alive] += some.T @ X[rows]
    return RecordSums(hh=hh, hx=hx[:, :-1], hy=hx[:, -1], xx=square[:-1, :-1], xy=square[:-1, -1])


def _gram(columns: np.ndarray) -> np.ndarray:
    (syrk,) = get_blas_funcs(("syrk",), (columns,))
    half = syrk(1.0, columns.T)
    return half + np.triu(half, 1).T


def gain(z: np.ndarray, K: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Change of the log evidence by a cause with amplitude N(mean, scale^2)."""
    q = 1.0 + scale**2 * K
    return 0.5 * (((scale * z) ** 2 + 2.0 * z * mean - K * mean**2) / q - np.log(q))


@dataclass(frozen=True, eq=False, kw_only=True)
class Held:
    """Histories eliminated record by record, and nothing else yet: normal equations of nuisance and small terms
    (`common`, without any prior, and `match`), of these with the causes (`cross`) and of the causes (K, z). `nodes`
    per record of histories by themselves, by causes, by the innovations and by the common columns."""

    log: float
    loose: tuple[Unknown, ...]
    level: float
    common: np.ndarray
    match: np.ndarray
    cross: np.ndarray
    K: np.ndarray
    z: np.ndarray
    nodes: tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Background:
    """All that every explanation has, eliminated, and `loose` histories beside it.

    log        log evidence of it alone;  log_prior  of its setting and its loose histories
    K, z       (causes, causes), (causes,): see the head of this module
    nodes      per record of histories by themselves, by causes, by the innovations, and what the common columns took
    pull       what the common columns took of the innovations
    """

    sums: Sums
    held: Held
    setting: Setting
    log: float
    log_prior: float
    K: np.ndarray
    z: np.ndarray
    nodes: tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], ...]
    pull: np.ndarray

    @property
    def loose(self) -> tuple[Unknown, ...]:
        return self.held.loose

    def loosened(self, entrance: Entrance, priors: Priors) -> list[Loosened]:
        """An unknown history that enters there, at every level and correlation time."""
        ports = [self.sums.port_number[p] for p in entrance.ports]
        rows = [self.sums.nodes_of(r, ports) for r in range(len(self.nodes))]
        parts = list(zip(self.nodes, rows, strict=True))
        back = np.concatenate([taken[:, b] for (_, _, _, taken), b in parts], axis=1)
        K = block_diag(*[hh[np.ix_(b, b)] for (hh, *_), b in parts]) - back.T @ back
        z = np.concatenate([hy[b] for (_, _, hy, _), b in parts]) - back.T @ self.pull
        F = np.concatenate([hf[b] for (_, hf, _, _), b in parts])
        found = []
        for tau in priors.times:
            roots = [np.linalg.cholesky(covariance(r.nodes, tau)) for r in self.sums.innovations.records]
            root = block_diag(*[part for part in roots for _ in ports])
            values, vectors = np.linalg.eigh(root.T @ K @ root)
            T = vectors.T @ root.T
            values, a, f = np.maximum(values, 0.0), T @ z, T @ F
            for v in priors.levels:
                d = v**2 / (1.0 + v**2 * values)
                log = 0.5 * float(d @ a**2 - np.log1p(v**2 * values).sum())
                prior = priors.level(v, entrance.log_prior)
                found.append(Loosened(unknown=(entrance.name, v, tau), log=log, log_prior=prior, T=T, d=d, a=a, f=f))
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Loosened:
    """An unknown history beside a background: change of the log evidence and log prior; in the eigenbasis T of its
    nodes, the posterior variances d, match a, and products f with the causes."""

    unknown: Unknown
    log: float
    log_prior: float
    T: np.ndarray
    d: np.ndarray
    a: np.ndarray
    f: np.ndarray

    @property
    def update(self) -> tuple[np.ndarray, np.ndarray]:
        """(U, u): by it K loses U'U and z loses U'u."""
        root = np.sqrt(self.d)
        return root[:, None] * self.f, root * self.a

    @cached_property
    def _spread(self) -> tuple[float, float]:
        """Mean square of the history's posterior deviation, and the 1-sigma of its square by that alone."""
        weight = self.T @ self.T.T
        return float(self.d @ np.diag(weight)), float(np.sqrt(2.0 * self.d @ weight**2 @ self.d))

    def as_large_as_matters(self, columns: Sequence[int], sizes: np.ndarray) -> float:
        """Probability that its mean square, beside causes of these sizes, is one or more, in units of what matters."""
        mean = self.T.T @ (self.d * (self.a - self.f[:, columns] @ sizes))
        spread, std = self._spread
        turned = self.T @ mean
        std = float(np.hypot(std, 2.0 * np.sqrt(max(float(self.d @ turned**2), 0.0))))
        n = len(self.d)
        return float(ndtr((float(mean @ mean) + spread - n) / max(std, 1e-9 * n)))


def covariance(nodes: np.ndarray, tau: float) -> np.ndarray:
    """Of a history at nodes of time, at a level of one."""
    return np.exp(-np.abs(nodes[:, None] - nodes) / tau)


def hold(sums: Sums, priors: Priors, level: float, loose: Sequence[Unknown] = ()) -> Held:
    """Histories eliminated, of a base level at all ports and of what is loose besides."""
    innovations, c, log = sums.innovations, sums.common, 0.0
    J = len(innovations.causes)
    common, match = np.zeros((c, c)), np.zeros(c)
    cross, K, z = np.zeros((c, J)), np.zeros((J, J)), np.zeros(J)
    nodes, levels = [], levels_of(sums, priors, level, loose)
    for r in range(len(sums.records)):
        one, gained = _without_histories(sums, r, levels)
        log += gained
        common += one.xx[:c, :c]
        match += one.xy[:c]
        has = np.flatnonzero(sums.picked[r] >= 0)
        at = sums.picked[r][has]
        cross[:, has] += one.xx[:c, at]
        K[np.ix_(has, has)] += one.xx[np.ix_(at, at)]
        z[has] += one.xy[at]
        hf = np.zeros((len(one.hy), J))
        hf[:, has] = one.hx[:, at]
        nodes.append((one.hh, hf, one.hy, one.hx[:, :c]))
    return Held(
        log=log,
        loose=tuple(loose),
        level=level,
        common=common,
        match=match,
        cross=cross,
        K=K,
        z=z,
        nodes=tuple(nodes),
    )


def levels_of(
    sums: Sums, priors: Priors, level: float, loose: Sequence[Unknown]
) -> dict[int, list[tuple[float, float]]]:
    """Port -> (level, correlation time) of the histories that it has."""
    middle = priors.times[len(priors.times) // 2]
    found = {p: [(level, middle)] if level else [] for p in range(len(sums.innovations.ports))}
    for name, of_this, tau in loose:
        entrance = next(e for e in sums.innovations.entrances if e.name == name)
        for port in entrance.ports:
            found[sums.port_number[port]].append((of_this, tau))
    return {p: levels for p, levels in found.items() if levels}


def _without_histories(
    sums: Sums, r: int, levels: Mapping[int, Sequence[tuple[float, float]]]
) -> tuple[RecordSums, float]:
    """The sums of a record with histories of these levels eliminated, and what they change the log evidence by."""
    one, nodes = sums.records[r], sums.innovations.records[r].nodes
    if not levels:
        return one, 0.0
    some = sums.nodes_of(r, list(levels))
    priors = [np.sum([v**2 * covariance(nodes, tau) for v, tau in at], axis=0) for at in levels.values()]
    precision = block_diag(*[np.linalg.inv(p) for p in priors])
    L = np.linalg.cholesky(one.hh[np.ix_(some, some)] + precision)
    right = np.column_stack([one.hh[some], one.hx[some], one.hy[some]])
    W = solve_triangular(L, right, lower=True, check_finite=False)
    h, x, y = W[:, : len(one.hy)], W[:, len(one.hy) : -1], W[:, -1]
    log = 0.5 * float(y @ y) - float(np.log(np.diag(L)).sum())
    log -= 0.5 * sum(float(np.linalg.slogdet(p)[1]) for p in priors)
    left = RecordSums(
        hh=one.hh - h.T @ h, hx=one.hx - h.T @ x, hy=one.hy - h.T @ y, xx=one.xx - x.T @ x, xy=one.xy - x.T @ y
    )
    return left, log


def background(sums: Sums, priors: Priors, held: Held, scales: Mapping[str, float]) -> Background:
    """Nuisance and small terms, at these scales, eliminated too."""
    innovations, k = sums.innovations, len(sums.innovations.precision)
    common, match = with_priors(innovations, held)
    small = small_information(innovations, scales)
    common[k:, k:] += small
    L, scale = root_of(common, priors.numerics.ridge)
    y, F = solved(L, scale, match), solved(L, scale, held.cross)
    stated = innovations.precision > 0.0
    log = held.log + 0.5 * float(y @ y) - log_determinant(L, scale)
    log += 0.5 * float(np.linalg.slogdet(small)[1]) + 0.5 * float(np.log(innovations.precision[stated]).sum())
    pulled = float(np.sum(innovations.pull[stated] ** 2 / innovations.precision[stated]))
    readings = sum(len(record.residual) for record in innovations.records)
    log -= 0.5 * (sums.square + pulled + innovations.log_determinant + readings * np.log(2.0 * np.pi))
    nodes = []
    for hh, hf, hy, hc in held.nodes:
        taken = solved(L, scale, hc.T)
        nodes.append((hh, hf - taken.T @ F, hy, taken))
    log_priors = {e.name: e.log_prior for e in innovations.entrances}
    prior = -float(np.log(len(priors.base))) - len(scales) * float(np.log(len(priors.bends)))
    prior += sum(priors.level(v, log_priors[name]) for name, v, _ in held.loose)
    return Background(
        sums=sums,
        held=held,
        setting=Setting(level=held.level, scales=tuple(sorted(scales.items()))),
        log=log,
        log_prior=prior,
        K=held.K - F.T @ F,
        z=held.z - F.T @ y,
        nodes=tuple(nodes),
        pull=y,
    )


def with_priors(innovations: WhitenedInnovations, held: Held) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of nuisance, its prior included, and of small terms, without theirs."""
    common, match, k = held.common.copy(), held.match.copy(), len(innovations.precision)
    common[range(k), range(k)] += innovations.precision
    match[:k] -= innovations.pull
    return common, match


def small_information(innovations: WhitenedInnovations, scales: Mapping[str, float]) -> np.ndarray:
    """Inverse prior covariance of the small terms at scales by owner."""
    scale = np.array([scales[owner] for owner in innovations.owners])
    return innovations.small_information / scale[:, None] / scale if len(scale) else np.zeros((0, 0))


def root_of(square: np.ndarray, ridge: float) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky factor of a matrix scaled to unit diagonal, and the scale; what has no information is left alone.

    `ridge`, which is added to the diagonal, keeps apart what rounding joins.
    """
    diagonal = np.diag(square)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)
    scaled = square * scale[:, None] * scale
    return np.linalg.cholesky(scaled + np.diag(np.where(diagonal > 0.0, ridge, 1.0))), scale


def solved(L: np.ndarray, scale: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Root of the inverse of what `root_of` took apart, times `right`."""
    scaled = right * (scale[:, None] if right.ndim == 2 else scale)
    return solve_triangular(L, scaled, lower=True, check_finite=False)


def log_determinant(L: np.ndarray, scale: np.ndarray) -> float:
    """Half of that of what `root_of` took apart."""
    return float(np.log(np.diag(L)).sum() - np.log(scale).sum())
