"""Projection of responses off what is fitted: their normal equations once everything that is fitted has adapted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence, gram_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Projection:
    """Normal equations of n whitened responses, the fitted slots and the small terms of an evidence eliminated.

    gram   (n, n) products of what is left of the responses: the information on their sizes
    match  (n,) products of that with the innovations
    """

    gram: np.ndarray
    match: np.ndarray

    @classmethod
    def shared(cls, evidence: Evidence, responses: Mapping[int, np.ndarray]) -> Projection:
        """Of responses with one size in all records: number of the record -> (samples, n)."""
        n = next(iter(responses.values())).shape[1]
        gram, match, cross = np.zeros((n, n)), np.zeros(n), np.zeros((len(evidence.newton), n))
        for r, own in responses.items():
            gram += own.T @ own
            cross += evidence.by_record[r].T @ own
            match += own.T @ evidence.fit.white[:, r].reshape(-1)
        return cls._eliminated(evidence, gram, match, cross)

    @classmethod
    def by_record(
        cls, evidence: Evidence, responses: Sequence[np.ndarray], products: tuple[np.ndarray, np.ndarray]
    ) -> Projection:
        """Of responses (samples, n) with sizes of its own in every record: n of the first record, and so on; their
        `products` as `Entrances` has them."""
        R, n = len(responses), responses[0].shape[1]
        gram, match = np.zeros((R * n, R * n)), np.zeros(R * n)
        cross = np.zeros((len(evidence.newton), R * n))
        for r, own in enumerate(responses):
            at = slice(r * n, (r + 1) * n)
            gram[at, at] = gram_of(own)
            cross[:, at], match[at] = products[0][r], products[1][r]
        return cls._eliminated(evidence, gram, match, cross)

    @classmethod
    def _eliminated(cls, evidence: Evidence, gram: np.ndarray, match: np.ndarray, cross: np.ndarray) -> Projection:
        spent = cross.T @ evidence.covariance @ cross
        return cls(gram=gram - spent, match=match - cross.T @ evidence.newton)
