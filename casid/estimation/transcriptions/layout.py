"""Records cut into segments of equal length, as arrays that a batched simulation takes.

Sizes: R records, K segments of all records together, L samples per segment, n states, m inputs, o outputs.
A segment that is shorter than L is padded with steps of no duration and missing outputs, so that no code below
needs to know about it. Nor need it know of sub-steps: where a sample interval takes several steps, the points between
them are samples at which nothing is measured. "Sample" means these too, but in `sample`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.transcriptions.steps import cached
from casid.model.system import Model
from casid.records.record import Record


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
    sample     per record (N,) flat index into (K*L) of each of its own samples
    times      per record the time stamps [s] of its samples and of the points between them
    substeps   steps per sample interval
    """

    length: int
    substeps: int
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
    times: tuple[np.ndarray, ...]

    @property
    def segments(self) -> int:
        """Number of segments K."""
        return len(self.record)

    def segments_of(self, record: int) -> slice:
        """The segments of one record."""
        stop = self.first[record + 1] if record + 1 < len(self.first) else len(self.record)
        return slice(int(self.first[record]), int(stop))


def watched(model: Model, layout: Layout, names: tuple[str, ...]) -> tuple[Model, Layout]:
    """The model with the named states and outputs as its outputs, and the layout on which all of them are present."""

    def build() -> Model:
        rows = [model.x[model.states.index(n)] if n in model.states else model.h[model.outputs.index(n)] for n in names]
        return replace(model, outputs=tuple(f"path of {n}" for n in names), h=ca.vertcat(*rows), equation=None)

    shape = (*layout.dt.shape, len(names))
    everywhere = {"z": np.zeros(shape), "present": np.ones(shape), "pattern": np.zeros(shape[:2], dtype=int)}
    return cached(model, ("watched", names), build), replace(layout, **everywhere, seen=np.ones((1, len(names))))


def _padded(values: np.ndarray, count: int, last: bool) -> np.ndarray:
    """Rows appended up to `count`: the last one repeated, or zeros."""
    extra = count - len(values)
    tail = np.repeat(values[-1:], extra, axis=0) if last else np.zeros((extra, *values.shape[1:]))
    return np.concatenate([values, tail])


def build_layout(problem: Problem, interval: int | None, substeps: int = 1) -> Layout:
    """Segments of `interval` samples, None: one segment per record, with `substeps` steps between two samples."""
    model = problem.model
    length = (interval or max(len(record) for record in problem.records)) * substeps
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("u0", "u1", "dt", "z", "present", "guess")}
    record_of, first, tied, sample, times = [], [], [], [], []
    count = 0
    for r, record in enumerate(problem.records):
        t = _refined(record.t, substeps)
        segments = -(-len(t) // length)
        total = segments * length
        u, following = _inputs(model, record, substeps)
        z = np.full((len(t), len(model.outputs)), np.nan)
        z[::substeps] = problem.outputs_of(record)
        parts["u0"].append(_padded(u, total, last=True))
        parts["u1"].append(_padded(following, total, last=True))
        parts["dt"].append(_padded(np.append(np.diff(t), 0.0), total, last=False))
        parts["z"].append(_padded(np.nan_to_num(z), total, last=False))
        parts["present"].append(_padded(np.isfinite(z).astype(float), total, last=False))
        guess = _refined(np.asarray(model.guess(record), dtype=float), substeps)
        parts["guess"].append(_padded(guess, total, last=True))
        record_of += [r] * segments
        first.append(count)
        tied += range(count, count + segments - 1)
        sample.append(count * length + substeps * np.arange(len(record)))
        times.append(t)
        count += segments
    arrays = {k: np.concatenate(v).reshape(count, length, *v[0].shape[1:]) for k, v in parts.items()}
    pattern, seen = _patterns(arrays["present"])
    return Layout(
        length=length,
        substeps=substeps,
        record=np.array(record_of),
        first=np.array(first),
        tied=np.array(tied, dtype=int),
        sample=tuple(sample),
        times=tuple(times),
        start=arrays["guess"][:, 0].copy(),
        pattern=pattern,
        seen=seen,
        **arrays,
    )


def _refined(values: np.ndarray, substeps: int) -> np.ndarray:
    """(substeps (N-1) + 1, ...) with points between the rows (N, ...), on straight lines."""
    if substeps == 1:
        return values
    share = (np.arange(substeps) / substeps).reshape(-1, *[1] * (values.ndim - 1))
    between = values[:-1, None] + share * (values[1:] - values[:-1])[:, None]
    return np.concatenate([between.reshape(substeps * (len(values) - 1), *values.shape[1:]), values[-1:]])


def _inputs(model: Model, record: Record, substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs at the start and at the end of every step; time itself never stands still."""
    u = record.matrix(model.inputs)
    straight = _refined(u, substeps)
    held = np.concatenate([np.repeat(u[:-1], substeps, axis=0), u[-1:]])
    is_held = np.array([record.hold_of(name) == "held" for name in model.inputs], dtype=bool)
    following = np.concatenate([straight[1:], straight[-1:]])
    return np.where(is_held, held, straight), np.where(is_held, held, following)


def _patterns(present: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, L) number of the pattern of each sample, and the patterns (patterns, o)."""
    everything = present.all(axis=2)
    nothing = ~present.any(axis=2)
    o = present.shape[2]
    if (everything | nothing).all():  # the usual case, without sorting
        return np.where(everything, 0, 1), np.stack([np.ones(o), np.zeros(o)])
    seen, pattern = np.unique(present.reshape(-1, o), axis=0, return_inverse=True)
    return pattern.reshape(present.shape[:2]), seen
