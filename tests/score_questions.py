"""Questions to the score, and the Gaussian densities that answer them written out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.explanations.explanation import (
    CauseColumn,
    Entrance,
    Explanation,
    HistoryPort,
    RecordColumns,
    WhitenedInnovations,
)
from casid.diagnosis.explanations.prior import Priors

ROWS, NODES = 60, 5


def a_question(seed: int, *, causes: int = 6, shapes: int = 2, records: int = 2) -> WhitenedInnovations:
    """White noise, seen through random columns of everything that may be asked for."""
    rng = np.random.default_rng(seed)
    columns = tuple(
        RecordColumns(
            residual=rng.standard_normal(ROWS),
            nuisance=rng.standard_normal((ROWS, 3)),
            small=0.2 * rng.standard_normal((ROWS, 4)),
            histories=tuple(0.5 * rng.standard_normal((ROWS, NODES + r)) for _ in range(2)),
            shapes=rng.standard_normal((ROWS, causes * shapes)),
            nodes=0.5 * np.arange(NODES + r),
        )
        for r in range(records)
    )
    root = rng.standard_normal((4, 4))
    return WhitenedInnovations(
        records=columns,
        precision=np.array([1.0, 0.3, 2.0]),
        pull=np.array([0.2, -0.1, 0.0]),
        small_information=root @ root.T + 3.0 * np.eye(4),
        owners=("a", "a", "b", "b"),
        ports=(HistoryPort(name="first", matters=1.0), HistoryPort(name="second", matters=0.4)),
        entrances=(
            Entrance(name="first", ports=("first",), log_prior=-2.0),
            Entrance(name="both", ports=("first", "second"), log_prior=-3.0),
        ),
        causes=tuple(
            CauseColumn(
                name=f"cause{i}",
                kind=f"kind{i % 2}",
                shape={r: shapes * i + s for r in range(records) if s == 0 or r == 0},
                mean=0.5 * s,
                scales=(0.2, 1.0),
                log_prior=-1.0 - 0.1 * i,
                matters=0.1,
            )
            for i in range(causes)
            for s in range(shapes)
        ),
        log_determinant=1.25,
    )


def with_response(asked: WhitenedInnovations, sizes: dict[int, float]) -> WhitenedInnovations:
    """The same with causes in the data, by their column."""
    records = []
    for r, one in enumerate(asked.records):
        y = one.residual.copy()
        for column, size in sizes.items():
            if r in asked.causes[column].shape:
                y += size * one.shapes[:, asked.causes[column].shape[r]]
        records.append(replace(one, residual=y))
    return replace(asked, records=tuple(records))


def moments(asked: WhitenedInnovations, one: Explanation, priors: Priors) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(innovations, mean, covariance) of all readings under an explanation, written out."""
    n = [len(record.residual) for record in asked.records]
    at = [slice(sum(n[:r]), sum(n[: r + 1])) for r in range(len(n))]
    y, mean, S = np.concatenate([r.residual for r in asked.records]), np.zeros(sum(n)), np.eye(sum(n))

    def add(columns: Sequence[np.ndarray], mu: np.ndarray, C: np.ndarray) -> None:
        nonlocal mean, S
        A = np.concatenate(columns)
        mean, S = mean + A @ mu, S + A @ C @ A.T

    add([r.nuisance for r in asked.records], -asked.pull / asked.precision, np.diag(1.0 / asked.precision))
    scale = np.array([dict(one.setting.scales)[o] for o in asked.owners])
    small = np.linalg.inv(asked.small_information) * scale[:, None] * scale
    add([r.small for r in asked.records], np.zeros(len(scale)), small)
    levels = [((port.name,), one.setting.level, priors.times[1]) for port in asked.ports]
    levels += [(next(e.ports for e in asked.entrances if e.name == name), v, tau) for name, v, tau in one.unknown]
    for ports, v, tau in levels:
        for p, port in enumerate(asked.ports):
            for r, record in enumerate(asked.records):
                if port.name in ports:
                    C = (v * port.matters) ** 2 * np.exp(-np.abs(record.nodes[:, None] - record.nodes) / tau)
                    S[at[r], at[r]] += record.histories[p] @ C @ record.histories[p].T
    for element in one.elements:
        cause = asked.causes[element.column]
        parts = [
            record.shapes[:, cause.shape[r]] if r in cause.shape else np.zeros(n[r])
            for r, record in enumerate(asked.records)
        ]
        add([p[:, None] for p in parts], np.array([cause.mean]), np.array([[element.scale**2]]))
    return y, mean, S


def density(asked: WhitenedInnovations, one: Explanation, priors: Priors) -> float:
    """Log density of the innovations under an explanation."""
    y, mean, S = moments(asked, one, priors)
    left = y - mean
    log = -0.5 * float(left @ np.linalg.solve(S, left) + np.linalg.slogdet(2.0 * np.pi * S)[1])
    return log - 0.5 * asked.log_determinant
