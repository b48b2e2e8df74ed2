"""A system with a simulator of its own, and the faults that it can hide: nothing of what casid estimates with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from casid.errors import InputError
from casid.model.library import Library
from casid.model.port import ModelPort, ports_of
from casid.model.system import Model
from casid.records.record import Record

_FINER = 20  # points per sample along which operators are followed
_BEFORE = 0.05  # of a record, that runs before it
_CREEP = 0.02  # speed about which dry friction reverses
# over which a hysteresis turns: of an input in half widths of it, of friction in what a speed runs in a unit of time
_STROKE = 3.0
_TRAVEL = 0.05
_SCATTER = 0.03  # of true parameters about the nominal ones, 1-sigma


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A hidden fault, in the words of the diagnosis; `size` in SI, `records` that have it (empty: all)."""

    kind: str
    target: str
    size: float
    term: str = ""
    records: tuple[str, ...] = ()
    onset: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.kind}({self.target}:{self.term})" if self.term else f"{self.kind}({self.target})"


@dataclass(frozen=True, kw_only=True)
class System:
    """What is diagnosed, and the truth behind it.

    rates, reads   (x, u, p) -> derivatives; readings: dictionaries in and out, of numbers or arrays
    regressors     name -> function of states and inputs, of a term that its equation may lack
    inputs         (rng, t) -> name -> (N,)
    start          (rng) -> state at the first sample
    sigma          output -> 1-sigma of its noise
    faults         kind, target, term, smallest and largest size
    matters        reading -> error that matters, where a share of its variation says little: a position that wanders
    """

    name: str
    model: Callable[[], Model]
    rates: Callable[[Mapping[str, Any], Mapping[str, Any], Mapping[str, float]], Mapping[str, Any]]
    reads: Callable[[Mapping[str, Any], Mapping[str, Any], Mapping[str, float]], Mapping[str, Any]]
    inputs: Callable[[np.random.Generator, np.ndarray], Mapping[str, np.ndarray]]
    start: Callable[[np.random.Generator], Mapping[str, float]]
    sigma: Mapping[str, float]
    step: float
    duration: float
    faults: Sequence[tuple[str, str, str, float, float]]
    regressors: Mapping[str, Callable[[Mapping[str, Any]], Any]] = field(default_factory=dict)
    exact: tuple[str, ...] = ()
    library: Library = field(default_factory=Library)
    matters: Mapping[str, float] = field(default_factory=dict)
    records: int = 4

    def ports(self) -> list[ModelPort]:
        """Where reality may differ from the model."""
        found = ports_of(self.model(), self.exact)
        return [replace(p, matters=self.matters.get(p.name)) if p.kind == "output" else p for p in found]

    def draw(self, seed: int, attempt: int = 0) -> Fault:
        """A fault by chance."""
        rng = np.random.default_rng([seed, 1, attempt] if attempt else [seed, 1])
        kind, target, term, low, high = self.faults[int(rng.integers(len(self.faults)))]
        size = float(rng.uniform(low, high))
        some = ("m2",) if kind in ("parameter_change", "sensor_stuck") else ()
        onset = float(rng.uniform(0.3, 0.6)) * self.duration if kind == "sensor_stuck" else 0.0
        return Fault(kind=kind, target=target, term=term, size=size, records=some, onset=onset)

    def fly(self, seed: int, fault: Fault | None) -> list[Record]:
        """Noisy records m1, m2, ... of the system with a fault in it. Raises InputError when it runs off with that."""
        rng = np.random.default_rng([seed, 2])
        nominal = self.model().nominal
        truth = {name: value * (1.0 + _SCATTER * rng.standard_normal()) for name, value in nominal.items()}
        return [self._record(rng, f"m{k + 1}", truth, fault) for k in range(self.records)]

    def _record(self, rng: np.random.Generator, name: str, p: Mapping[str, float], fault: Fault | None) -> Record:
        t = np.arange(0.0, self.duration, self.step)
        # it has run before the record begins, with the inputs as they are there: a late reading has something to show
        before = int(_BEFORE * len(t))
        fine = np.linspace(t[0] - before * self.step, t[-1], (len(t) - 1 + before) * _FINER + 1)
        commanded, x0 = self.inputs(rng, t), self.start(rng)
        there = fault is not None and (not fault.records or name in fault.records)
        one = fault if there else None
        p = _shifted(p, one)
        builds_up = one is not None and one.kind == "hysteresis" and one.target in x0
        acts = {n: _operated(one, n, fine, np.interp(fine, t, u)) for n, u in commanded.items()}

        def rates(now: float, state: np.ndarray) -> list[float]:
            u = {n: np.interp(now, fine, series) for n, series in acts.items()}
            x = dict(zip(x0, state, strict=False))
            found = dict(self.rates(x, u, p))
            if one is not None and one.kind == "missing_term":
                found[one.target] += one.size * self._term(one.term, {**x, **u})
            if one is not None and one.kind == "dry_friction":
                found[one.target] -= one.size * np.tanh(x[one.target] / _CREEP)
            if one is None or not builds_up:
                return [found[n] for n in x0]
            found[one.target] -= one.size * state[-1]
            return [*(found[n] for n in x0), (x[one.target] - abs(x[one.target]) * state[-1]) / _TRAVEL]

        solved = solve_ivp(
            rates,
            (fine[0], fine[-1]),
            [*x0.values(), *([0.0] if builds_up else [])],
            t_eval=fine,
            rtol=1e-8,
            atol=1e-9,
            max_step=self.step,
            method="LSODA",
        )
        if not solved.success or not np.isfinite(solved.y).all():
            raise InputError(f"{self.name}: the system runs off with {fault.name if fault else 'nothing'}")
        readings = self.reads(dict(zip(x0, solved.y, strict=False)), acts, p)
        channels = dict(commanded)
        for n, values in readings.items():
            seen = _operated(one, n, fine, values)[before * _FINER :: _FINER]
            channels[n] = seen + self.sigma[n] * rng.standard_normal(len(t))
        return Record(name=name, t=t, channels=channels)

    def _term(self, term: str, symbols: Mapping[str, Any]) -> Any:
        if term in self.regressors:
            return self.regressors[term](symbols)
        parts = [part.split("^") for part in term.split("*")]
        return reduce(lambda a, b: a * b, (symbols[n] ** int(power[0] if power else 1) for n, *power in parts))


def _shifted(p: Mapping[str, float], fault: Fault | None) -> dict[str, float]:
    changed = dict(p)
    if fault is not None and fault.kind == "parameter_change":
        changed[fault.target] += fault.size
    return changed


def _operated(fault: Fault | None, name: str, t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A fine series as a fault of this input or reading leaves it."""
    if fault is None or fault.target != name:
        return y
    size = fault.size
    if fault.kind in ("input_delay", "sensor_delay"):
        return np.interp(t - size, t, y)
    if fault.kind in ("actuator_lag", "sensor_lag"):
        return _followed(y, lambda at, u: at + (u - at) * (1.0 - np.exp(-(t[1] - t[0]) / size)))
    if fault.kind == "backlash":
        return _followed(y, lambda at, u: min(max(at, u - size), u + size))
    if fault.kind == "hysteresis":
        return y - size * _memory(y, _STROKE * size)
    if fault.kind == "rate_limit":
        return _followed(y, lambda at, u: at + min(max(u - at, -size * (t[1] - t[0])), size * (t[1] - t[0])))
    if fault.kind == "second_order_actuator":
        return _swung(t, y, size)
    simple: dict[str, Callable[[], np.ndarray]] = {
        "input_limit": lambda: np.minimum(y, size) if fault.term == "above" else np.maximum(y, size),
        "dead_zone": lambda: np.sign(y) * np.maximum(np.abs(y) - size, 0.0),
        **dict.fromkeys(("sensor_bias", "input_offset"), lambda: y + size),
        **dict.fromkeys(("sensor_scale", "input_scale"), lambda: y * (1.0 + size)),
        "sensor_stuck": lambda: np.where(t >= fault.onset, np.interp(fault.onset, t, y), y),
    }
    return simple[fault.kind]() if fault.kind in simple else y


def _followed(y: np.ndarray, follow: Callable[[float, float], float]) -> np.ndarray:
    out = y.copy()
    for k in range(1, len(y)):
        out[k] = follow(out[k - 1], y[k])
    return out


def _memory(y: np.ndarray, stroke: float) -> np.ndarray:
    """What is left of the signs of all movements before: each fades with the way since then."""
    z = np.zeros(len(y))
    for k, step in enumerate(np.diff(y).tolist()):
        fades = np.exp(-abs(step) / stroke)
        z[k + 1] = z[k] * fades + (1.0 - fades) * np.sign(step)
    return z


def _swung(t: np.ndarray, y: np.ndarray, radian: float, damping: float = 0.5) -> np.ndarray:
    """A series as an oscillator follows it: the integral of its two states, Euler's steps with the new speed."""
    out, speed, dt = y.copy(), 0.0, t[1] - t[0]
    for k in range(1, len(y)):
        speed += dt * ((y[k] - out[k - 1]) / radian**2 - 2.0 * damping * speed / radian)
        out[k] = out[k - 1] + dt * speed
    return out


def levels(rng: np.random.Generator, t: np.ndarray, low: float, high: float, shortest: float) -> np.ndarray:
    """An input that goes from level to level on ramps of a quarter of the time that it stays at each."""
    count = int((t[-1] - t[0]) / (1.5 * shortest)) + 2
    at = t[0] + np.cumsum(np.r_[0.0, rng.uniform(shortest, 2.0 * shortest, count)])
    heights = rng.uniform(low, high, count + 1)
    corners = np.stack([at[1:], at[1:] + 0.25 * shortest], axis=1).ravel()
    values = np.stack([heights[:-1], heights[1:]], axis=1).ravel()
    return np.interp(t, corners, values)
