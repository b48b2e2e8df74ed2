"""Regression of measured coefficients on the motion, with the derivatives of a file as prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from scipy import special

from casid.data_check.criteria import DataCriteria
from casid.model.terms import parse_term
from casid.signals import SURFACES


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """Regressors of a coefficient: names, terms and values of the file's derivatives, without the constant. Behind them
    come terms that errors of healthy instruments make, with their spread."""

    names: tuple[str, ...]
    terms: tuple[str, ...]
    prior: np.ndarray
    errors: tuple[tuple[str, float], ...]
    sizes: np.ndarray  # of which the errors of the values are parts

    @property
    def all_terms(self) -> tuple[str, ...]:
        return (*self.terms, *(term for term, _ in self.errors))

    @property
    def about(self) -> np.ndarray:
        """Value of every column."""
        return np.append(self.prior, np.zeros(len(self.errors)))

    @property
    def besides(self) -> np.ndarray:
        """Spread of every column beside its value."""
        return np.append(np.zeros(len(self.prior)), [spread for _, spread in self.errors])

    @property
    def sized(self) -> np.ndarray:
        """Size of every column, 0 of the errors of instruments."""
        return np.append(self.sizes, np.zeros(len(self.errors)))

    def columns(self, regressors: Mapping[str, np.ndarray]) -> np.ndarray:
        """(N, columns) of regressors."""
        count = len(regressors["alpha"])
        modelled = [parse_term(term).evaluate(regressors) * np.ones(count) for term in self.terms]
        return np.stack([*modelled, *(regressors[term] for term, _ in self.errors)], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Squares:
    """Sums over samples: of the measured coefficient y and its regressors X, and of their products without means."""

    samples: int
    y: float
    X: np.ndarray
    yy: float
    Xy: np.ndarray
    XX: np.ndarray

    def __add__(self, other: Squares) -> Squares:
        return Squares(
            samples=self.samples + other.samples,
            y=self.y + other.y,
            X=self.X + other.X,
            yy=self.yy + other.yy,
            Xy=self.Xy + other.Xy,
            XX=self.XX + other.XX,
        )

    def off(self, values: np.ndarray) -> float:
        """Sum of squares that given values of the derivatives leave."""
        return float(self.yy - 2.0 * values @ self.Xy + values @ self.XX @ values)

    @property
    def left(self) -> float:
        """Variance that free derivatives leave."""
        explained = float(self.Xy @ np.linalg.pinv(self.XX, rcond=1e-10, hermitian=True) @ self.Xy)
        return max(self.yy - explained, 0.0) / self.samples


Parts = Mapping[str, Squares]


def squares_of(y: np.ndarray, X: np.ndarray, at: np.ndarray) -> Squares | None:
    """Sums over the samples `at`; None of too few, or of what is not finite or does not vary."""
    y = y[at]
    X = X[at]
    if len(at) < 2 * X.shape[1] or not (np.isfinite(X).all() and np.isfinite(y).all() and np.ptp(y) > 0.0):
        return None
    sums, (y, X) = (float(y.sum()), X.sum(axis=0)), (y - y.mean(), X - X.mean(axis=0))
    return Squares(samples=len(y), y=sums[0], X=sums[1], yy=float(y @ y), Xy=X.T @ y, XX=X.T @ X)


def together(parts: Sequence[Parts], coefficient: str) -> Squares:
    return reduce(add, (one[coefficient] for one in parts if coefficient in one))


def log_evidence(squares: Squares, row: Row, noise: float, criteria: DataCriteria, minor: float = 0.0) -> float:
    """Log marginal likelihood of a coefficient, up to what all alternatives share.

    Derivatives are about `prior`, within a part of it or what makes a `minor` part of the coefficient's variation; one
    may be an outlier, as a damper's. Those of surfaces keep their sign and `criteria.fair` of their size."""
    prior = row.about
    varies = minor * np.sqrt(max(float(prior @ squares.XX @ prior), 0.0))
    spread = np.hypot(criteria.rough * row.sized, varies / np.sqrt(np.maximum(np.diag(squares.XX), 1e-300)))
    spread = np.hypot(spread, row.besides)
    may = [i for i, term in enumerate(row.terms) if term not in SURFACES]
    each = np.tile(spread, (len(may) + 1, 1))
    each[np.arange(len(may)), may] = criteria.outlying * row.sized[may]
    weights = np.append(np.full(len(may), criteria.outlier / max(len(may), 1)), 1.0 - criteria.outlier)
    off = squares.off(prior)
    b = each * (squares.Xy - squares.XX @ prior) / noise**2
    inverse = np.linalg.inv(np.eye(len(prior)) + each[:, :, None] * squares.XX * each[:, None, :] / noise**2)
    shift = np.einsum("kij,kj->ki", inverse, b)
    evidence = -0.5 * (off / noise**2 - np.sum(shift * b, axis=1)) + 0.5 * np.linalg.slogdet(inverse)[1]
    for i, (term, value) in enumerate(zip(row.all_terms, prior, strict=True)):
        if term in SURFACES:
            above = (1.0 - criteria.fair) * abs(value) / each[:, i]
            posterior = (above + np.sign(value) * shift[:, i]) / np.sqrt(inverse[:, i, i])
            evidence += np.maximum(special.log_ndtr(posterior) - special.log_ndtr(above), criteria.impossible)
    return float(special.logsumexp(evidence, b=weights))
