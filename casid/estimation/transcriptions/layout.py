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
from casid.model.built import cached
from casid.model.system import Model
from casid.model.timeline import Timeline, between_samples, timeline
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """Data of all records in segments."""

    length: int
    substeps: int  # steps per sample interval
    record: np.ndarray  # (K,) record of each segment
    first: np.ndarray  # (R,) first segment of each record; its last is the one before the next record's first
    tied: np.ndarray  # (K-R,) segments that are followed by another one of the same record (they have a defect)
    start: np.ndarray  # (K, n) first guess of the state at the start of each segment
    guess: np.ndarray
    u0: np.ndarray  # u0, u1: (K, L, m) inputs at the start and at the end of each sample interval
    u1: np.ndarray
    dt: np.ndarray  # (K, L) [s], zero where padded
    z: np.ndarray  # (K, L, o) measured outputs, zero where missing
    present: np.ndarray  # (K, L, o) whether measured
    pattern: np.ndarray  # (K, L) row of `seen` that marks what is measured; seen (patterns, o) 1 where measured, else 0
    seen: np.ndarray
    sample: tuple[np.ndarray, ...]  # per record (N,) flat index into (K*L) of each of its own samples
    times: tuple[np.ndarray, ...]  # per record the time [s] at each of its segments' samples, padding included
    live: np.ndarray  # (K,) samples of each segment after which there is nothing but padding
    jump: np.ndarray  # (K,) number of the event at the end of each segment, -1 where there is none

    @property
    def segments(self) -> int:
        """Number of segments K."""
        return len(self.record)

    @property
    def ranges(self) -> np.ndarray:
        """(o,) largest minus smallest measurement of each output, zero where there is none."""
        low, high = (np.where(self.present, self.z, one) for one in (np.inf, -np.inf))
        return np.maximum(high.max(axis=(0, 1)) - low.min(axis=(0, 1)), 0.0)

    def residuals(self, y: np.ndarray) -> np.ndarray:
        """Subtract the measurements from outputs (K, L, o); zero where nothing is measured, whatever the output."""
        return np.where(self.present, y - self.z, 0.0)

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
    pattern = np.zeros(shape[:2], dtype=np.int32)
    everywhere = {"z": np.zeros(shape), "present": np.ones(shape, dtype=bool), "pattern": pattern}
    return cached(model, ("watched", names), build), replace(layout, **everywhere, seen=np.ones((1, len(names))))


def _cut(rows: int, jumps: list[tuple[int, int]], interval: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segments of `interval` rows, new ones at every jump (row, event); padding repeats the row that comes next. Gives
    (samples,) the row of each sample of them, (segments,) live as in `Layout`, (segments,) the event at the end."""
    row = []
    live = []
    jump = []
    first = 0
    for last, event in (*jumps, (rows, -1)):
        count = max(-(-(last - first) // interval), 1)
        own = np.minimum(first + np.arange(count * interval), min(last, rows - 1))
        row.append(own)
        live += [interval] * (count - 1) + [last - first - (count - 1) * interval]
        jump += [-1] * (count - 1) + [event]
        first = last
    return np.concatenate(row), np.array(live), np.array(jump)


def build_layout(problem: Problem, interval: int | None, substeps: int = 1) -> Layout:
    """Segments of `interval` samples, None: one segment per record, with `substeps` steps between two samples. Events
    are points between samples too, and begin a segment."""
    model = problem.model
    order = list(problem.model.events)
    lines = [timeline(model, record) for record in problem.records]
    length = (interval or max(_longest(line) for line in lines)) * substeps
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("u0", "u1", "dt", "z", "present", "guess")}
    per_segment: dict[str, list[np.ndarray]] = {k: [] for k in ("record", "live", "jump")}
    first = []
    tied = []
    sample = []
    times = []
    count = 0
    for r, (record, line) in enumerate(zip(problem.records, lines, strict=True)):
        t = _refined(line.t, substeps)
        row, live, jump = _cut(len(t), [(at * substeps, order.index(event)) for at, event in line.jumps], length)
        segments = len(live)
        is_live = (np.arange(length) < live[:, None]).ravel()
        u, following = _inputs(model, record, line, substeps)
        at = np.empty(len(t), dtype=int)
        at[row[is_live]] = np.flatnonzero(is_live)
        measured = at[substeps * line.sample]
        z = np.full((segments * length, len(model.outputs)), np.nan)
        z[measured] = problem.outputs_of(record)
        parts["u0"].append(u[row])
        parts["u1"].append(following[row])
        parts["dt"].append(np.where(is_live, np.append(np.diff(t), 0.0)[row], 0.0))
        parts["present"].append(np.isfinite(z))
        parts["z"].append(np.nan_to_num(z, copy=False))
        guess = between_samples(record, line, np.asarray(model.guess(record), dtype=float))
        parts["guess"].append(_refined(guess, substeps)[row])
        per_segment["record"].append(np.full(segments, r))
        per_segment["live"].append(live)
        per_segment["jump"].append(jump)
        first.append(count)
        tied += range(count, count + segments - 1)
        sample.append(count * length + measured)
        times.append(t[row])
        count += segments
    # one after the other, each without its parts: of a long record they are all there is
    arrays = {k: _together(parts.pop(k), (count, length)) for k in tuple(parts)}
    pattern, seen = _patterns(arrays["present"])
    return Layout(
        length=length,
        substeps=substeps,
        first=np.array(first),
        tied=np.array(tied, dtype=int),
        sample=tuple(sample),
        times=tuple(times),
        start=arrays["guess"][:, 0].copy(),
        pattern=pattern,
        seen=seen,
        **{k: np.concatenate(v) for k, v in per_segment.items()},
        **arrays,
    )


def _together(parts: list[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """The parts (rows, ...) of all records as (segments, samples, ...)."""
    whole = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return whole.reshape(*shape, *whole.shape[1:])


def _longest(line: Timeline) -> int:
    """Rows of the longest stretch without an event."""
    return int(np.diff([0, *(row for row, _ in line.jumps), len(line.t)]).max())


def _refined(values: np.ndarray, substeps: int) -> np.ndarray:
    """(substeps (N-1) + 1, ...) with points between the rows (N, ...), on straight lines."""
    if substeps == 1:
        return values
    share = (np.arange(substeps) / substeps).reshape(-1, *[1] * (values.ndim - 1))
    between = values[:-1, None] + share * (values[1:] - values[:-1])[:, None]
    return np.concatenate([between.reshape(substeps * (len(values) - 1), *values.shape[1:]), values[-1:]])


def _inputs(model: Model, record: Record, line: Timeline, substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs at the start and at the end of every step; time itself is never held."""
    is_held = np.array([record.hold_of(name) == "held" for name in model.inputs], dtype=bool)
    u = between_samples(record, line, record.matrix(model.inputs), is_held)
    straight = _refined(u, substeps)
    held = np.concatenate([np.repeat(u[:-1], substeps, axis=0), u[-1:]])
    following = np.concatenate([straight[1:], straight[-1:]])
    return np.where(is_held, held, straight), np.where(is_held, held, following)


def _patterns(present: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, L) number of the pattern of each sample, and the patterns (patterns, o)."""
    everything = present.all(axis=2)
    nothing = ~present.any(axis=2)
    o = present.shape[2]
    if (everything | nothing).all():  # the usual case, without sorting
        return np.where(everything, np.int32(0), np.int32(1)), np.stack([np.ones(o), np.zeros(o)])
    seen, pattern = np.unique(present.reshape(-1, o), axis=0, return_inverse=True)
    return pattern.reshape(present.shape[:2]).astype(np.int32), seen.astype(float)
