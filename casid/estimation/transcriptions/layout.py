"""Records cut into segments of equal length, as arrays that a batched simulation takes.

Sizes: R records, K segments of all records together, L samples per segment, n states, m inputs, o outputs.
A segment that is shorter than L is padded with steps of no duration and missing outputs, so that no code below
needs to know about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.estimation.problem import Problem


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """Data of all records in segments.

    record     (K,) record of each segment
    first      (R,) first segment of each record; its last is the one before the next record's first
    tied       (K-R,) segments that are followed by another one of the same record (they have a defect)
    start      (K, n) first guess of the state at the start of each segment
    u0, u1     (K, L, m) inputs at the start and at the end of each sample interval
    dt         (K, L) [s], zero where padded
    z          (K, L, o) measured outputs, zero where missing
    present    (K, L, o) 1 where measured, else 0
    pattern    (K, L) which row of `seen` says what is measured; seen (patterns, o) 1 where measured, else 0
    sample     per record (N,) flat index into (K*L) of each sample
    """

    length: int
    record: np.ndarray
    first: np.ndarray
    tied: np.ndarray
    start: np.ndarray
    guess: np.ndarray
    u0: np.ndarray
    u1: np.ndarray
    dt: np.ndarray
    z: np.ndarray
    present: np.ndarray
    pattern: np.ndarray
    seen: np.ndarray
    sample: tuple[np.ndarray, ...]

    @property
    def segments(self) -> int:
        """Number of segments K."""
        return len(self.record)

    def segments_of(self, record: int) -> slice:
        """The segments of one record."""
        stop = self.first[record + 1] if record + 1 < len(self.first) else len(self.record)
        return slice(int(self.first[record]), int(stop))


def _padded(values: np.ndarray, count: int, last: bool) -> np.ndarray:
    """Rows appended up to `count`: the last one repeated, or zeros."""
    extra = count - len(values)
    tail = np.repeat(values[-1:], extra, axis=0) if last else np.zeros((extra, *values.shape[1:]))
    return np.concatenate([values, tail])


def build_layout(problem: Problem, interval: int | None) -> Layout:
    """Segments of `interval` samples; None: one segment per record."""
    model = problem.model
    length = interval or max(len(record) for record in problem.records)
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("u0", "u1", "dt", "z", "present", "guess")}
    record_of, first, tied, sample = [], [], [], []
    count = 0
    for r, record in enumerate(problem.records):
        segments = -(-len(record) // length)
        total = segments * length
        u = record.matrix(model.inputs) if model.inputs else np.zeros((len(record), 0))
        following = np.concatenate([u[1:], u[-1:]]) if record.hold == "linear" else u
        z = problem.measured(record)
        parts["u0"].append(_padded(u, total, last=True))
        parts["u1"].append(_padded(following, total, last=True))
        parts["dt"].append(_padded(np.append(np.diff(record.t), 0.0), total, last=False))
        parts["z"].append(_padded(np.nan_to_num(z), total, last=False))
        parts["present"].append(_padded(np.isfinite(z).astype(float), total, last=False))
        parts["guess"].append(_padded(np.asarray(model.guess(record), dtype=float), total, last=True))
        record_of += [r] * segments
        first.append(count)
        tied += range(count, count + segments - 1)
        sample.append(count * length + np.arange(len(record)))
        count += segments
    arrays = {k: np.concatenate(v).reshape(count, length, *v[0].shape[1:]) for k, v in parts.items()}
    pattern, seen = _patterns(arrays["present"])
    return Layout(
        length=length,
        record=np.array(record_of),
        first=np.array(first),
        tied=np.array(tied, dtype=int),
        sample=tuple(sample),
        start=arrays["guess"][:, 0].copy(),
        pattern=pattern,
        seen=seen,
        **arrays,
    )


def _patterns(present: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, L) number of the pattern of each sample, and the patterns (patterns, o)."""
    everything = present.all(axis=2)
    nothing = ~present.any(axis=2)
    o = present.shape[2]
    if (everything | nothing).all():  # the usual case, without sorting
        return np.where(everything, 0, 1), np.stack([np.ones(o), np.zeros(o)])
    seen, pattern = np.unique(present.reshape(-1, o), axis=0, return_inverse=True)
    return pattern.reshape(present.shape[:2]), seen
