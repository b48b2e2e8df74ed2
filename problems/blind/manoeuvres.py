"""Flight-test inputs drawn from a random generator: multi-steps, sweeps, multisines and bank-to-bank, in any order.

Every record moves all three surfaces, some the throttle; the sign of an input takes back what the earlier ones on the
same control have left over, as a pilot would who wants to stay near trim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

CONTROLS: tuple[str, ...] = ("delta_e", "delta_a", "delta_r", "throttle")
Levels = tuple[tuple[float, float], ...]
# (duration in time units, level in input sizes)
PATTERNS: Mapping[str, Levels] = MappingProxyType(
    {
        "doublet": ((1, 1), (1, -1)),
        "double doublet": ((1, 1), (1, -1), (1, 1), (1, -1)),
        "1-2-1": ((1, 1), (2, -1), (1, 1)),
        "3-2-1-1": ((3, 1), (2, -1), (1, 1), (1, -1)),
        "1-1-2-3": ((1, 1), (1, -1), (2, 1), (3, -1)),
        "2-1-1": ((2, 1), (1, -1), (1, 1)),
    }
)
BANK_TO_BANK: Levels = ((1, 1), (2.5, 0), (2, -1), (2.5, 0), (1, 1))
_THROTTLE: tuple[Levels, ...] = (((4, 1), (4, -1)), ((6, -1),), ((3, 1), (5, -1), (2, 1)))
_FREE_S = 2.5  # of a record without any input, together


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One input on one control, over `length_s`, from the record's `start_s` on, in units of the control's size."""

    control: str
    shape: str
    length_s: float
    start_s: float = 0.0
    level: float = 1.0
    levels: Levels = ()
    unit_s: float = 1.0
    rise_s: float = 0.2
    phases: tuple[float, ...] = ()

    def at(self, t: np.ndarray) -> np.ndarray:
        """(N,) input at times t [s] of the record."""
        tau = t - self.start_s
        inside = (tau >= 0.0) & (tau <= self.length_s)
        if self.shape == "sweep":
            low, high = 0.12 / self.unit_s, 0.7 / self.unit_s
            wave = np.sin(2.0 * np.pi * (low * tau + 0.5 * (high - low) * tau**2 / self.length_s))
            return np.where(inside, self.level * wave, 0.0) * self._faded(tau)
        if self.shape == "multisine":
            whole = [k / self.length_s for k in _harmonics(self.length_s, self.unit_s, len(self.phases))]
            wave = sum(np.sin(2.0 * np.pi * f * tau + a) for f, a in zip(whole, self.phases, strict=True))
            scale = self.level * np.sqrt(1.5 / len(self.phases))
            return np.where(inside, scale * wave, 0.0) * self._faded(tau)
        out, start = np.zeros_like(t), 0.0
        for duration, level in self.levels:
            stop = start + duration * self.unit_s
            out += self.level * level * (_edge((tau - start) / self.rise_s) - _edge((tau - stop) / self.rise_s))
            start = stop
        return out

    @property
    def area(self) -> float:
        """Integral of a multi-step; sweeps and multisines leave nothing behind."""
        return self.level * self.unit_s * sum(d * level for d, level in self.levels)

    def _faded(self, tau: np.ndarray) -> np.ndarray:
        return _edge(tau / 0.4) * _edge((self.length_s - tau) / 0.4)


def draw_segments(
    rng: np.random.Generator, duration_s: float, units_s: Mapping[str, float], throttle: bool
) -> tuple[Segment, ...]:
    """Inputs of one record, one after another or overlapping a little.

    units_s   time unit of multi-steps per control [s]; some half a period of the motion that it excites
    throttle  whether the throttle is moved too
    """
    needed = CONTROLS[:3]
    budget = duration_s - _FREE_S - (3.0 if throttle else 0.0)
    chosen = [_draw(rng, control, units_s[control], budget / 3.0) for control in needed]
    left = budget - sum(segment.length_s for segment in chosen)
    while left > 3.0:
        control = str(rng.choice(list(needed), p=(0.4, 0.25, 0.35)))
        further = _draw(rng, control, units_s[control], left)
        if further.length_s > left:
            break
        chosen.append(further)
        left -= further.length_s + 0.4
    order = [chosen[i] for i in rng.permutation(len(chosen))]
    placed = _placed(rng, order, duration_s)
    if throttle:
        levels = _THROTTLE[rng.integers(len(_THROTTLE))]
        length = sum(d for d, _ in levels) * units_s["throttle"]
        start = float(rng.uniform(2.0, max(duration_s - length - 2.0, 3.0)))
        sign = float(rng.choice((-1.0, 1.0)))
        placed.append(
            Segment(
                control="throttle",
                shape="steps",
                length_s=length,
                start_s=start,
                levels=levels,
                rise_s=0.6,
                unit_s=units_s["throttle"],
                level=sign * float(rng.uniform(0.8, 1.2)),
            )
        )
    return tuple(placed)


def histories(segments: tuple[Segment, ...], t: np.ndarray, sizes: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Deviation from trim per control, (N,); surfaces [rad], throttle in the unit of its size."""
    out = {name: np.zeros_like(t) for name in CONTROLS}
    for segment in segments:
        out[segment.control] += sizes[segment.control] * segment.at(t)
    return out


def _draw(rng: np.random.Generator, control: str, unit_s: float, room_s: float) -> Segment:
    """A segment that takes no more than about `room_s`."""
    unit = unit_s * float(rng.uniform(0.85, 1.2))
    rise = float(rng.uniform(0.12, 0.3))
    fitting = {name: p for name, p in PATTERNS.items() if sum(d for d, _ in p) * unit <= room_s}
    if control == "delta_a" and 9.0 * unit <= room_s:
        fitting["bank-to-bank"] = BANK_TO_BANK
    shapes = [*fitting, *(["sweep", "multisine"] if room_s >= 6.0 else [])]
    shape = str(rng.choice(shapes)) if shapes else "doublet"
    level = float(rng.uniform(0.75, 1.15))
    if shape in ("sweep", "multisine"):
        length = min(float(rng.uniform(6.0, 9.0)), room_s)
        phases = tuple(rng.uniform(0.0, 2.0 * np.pi, 4).tolist()) if shape == "multisine" else ()
        return Segment(control=control, shape=shape, length_s=length, level=0.8 * level, unit_s=unit, phases=phases)
    levels = fitting.get(shape, PATTERNS["doublet"])
    length = sum(d for d, _ in levels) * unit
    return Segment(
        control=control, shape="steps", length_s=length, level=level, levels=levels, unit_s=unit, rise_s=rise
    )


def _placed(rng: np.random.Generator, order: list[Segment], duration_s: float) -> list[Segment]:
    """Start times and signs."""
    spare = max(duration_s - 1.0 - sum(segment.length_s for segment in order), 0.5)
    gaps = rng.dirichlet(np.ones(len(order) + 1)) * spare
    at, out = 0.5, list[Segment]()
    left_over: dict[str, float] = dict.fromkeys(CONTROLS, 0.0)
    for segment, gap in zip(order, gaps, strict=False):
        at += gap
        before = left_over[segment.control]
        sign = float(rng.choice((-1.0, 1.0))) if segment.area * before == 0.0 else -np.sign(before * segment.area)
        moved = replace(segment, start_s=at, level=sign * segment.level)
        left_over[segment.control] += moved.area
        at += segment.length_s
        out.append(moved)
    return out


def _harmonics(length_s: float, unit_s: float, count: int) -> list[int]:
    """Harmonics of the record's length, spread over the band that the control excites."""
    low, high = max(1, round(0.1 / unit_s * length_s)), max(3, round(0.6 / unit_s * length_s))
    return [round(k) for k in np.linspace(low, high, count)]


def _edge(x: np.ndarray) -> np.ndarray:
    """Smooth step from 0 at x = 0 to 1 at x = 1."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0.0, 1.0))
