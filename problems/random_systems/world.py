"""A random world: a linear model as given, a truth that differs from it, and records of that truth.

The truth is integrated in numpy. It differs from the model in its values, and by one nonlinearity, a hidden feedback or
nothing; its noise is white or coloured; the held-out record is flown like the others, at another amplitude, or by
another truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import casid as cs
from casid.model.system import Model
from casid.records.record import Record

_FINER = 3  # steps of integration per sample
_STATED = 0.2  # relative uncertainty of the values as given
KINDS = ("lag", "oscillator", "oscillator, two outputs", "pair")
TRUTHS = ("exact", "values", "square", "cube", "friction", "dead zone", "saturation", "feedback")
HELD_OUT = ("alike", "larger", "other")


@dataclass(frozen=True, kw_only=True)
class World:
    """A drawn problem.

    Attributes
    ----------
    kind, truth, held_out
        The structure of the model, what the truth has beside it, and how the held-out record was flown.
    model
        The model as given, with the stated uncertainty of its values.
    records, held
        The fitted records, and the held-out one.
    exact
        States with exact equations.
    clean
        Name of output -> readings of the held-out record without noise.
    noise
        Name of output -> 1-sigma of its noise.
    """

    kind: str
    truth: str
    held_out: str
    model: Model
    records: tuple[Record, ...]
    held: Record
    exact: tuple[str, ...]
    clean: dict[str, np.ndarray]
    noise: dict[str, float]


@cache
def model_of(kind: str) -> Model:
    """The linear model of a kind, with values of 1."""
    if kind == "lag":
        return cs.define_model(
            kind,
            states=("x",),
            inputs=("u",),
            outputs=("x",),
            parameters={"a": 1.0, "b": 1.0},
            dynamics=lambda s: {"x": -s.a * s.x + s.b * s.u},
            output=lambda s: {"x": s.x},
        )
    if kind == "pair":
        return cs.define_model(
            kind,
            states=("x", "v", "y"),
            inputs=("u", "w"),
            outputs=("x", "v", "y", "z"),
            parameters={"a": 1.0, "d": 1.0, "b": 1.0, "c": 1.0, "e": 1.0},
            dynamics=lambda s: {
                "x": s.v,
                "v": -s.a * s.x - s.d * s.v + s.b * s.u,
                "y": -s.c * s.y + s.e * s.w + 0.3 * s.x,
            },
            output=lambda s: {"x": s.x, "v": s.v, "y": s.y, "z": s.x + s.y},
        )
    outputs = ("x",) if kind == "oscillator" else ("x", "v")
    return cs.define_model(
        kind,
        states=("x", "v"),
        inputs=("u",),
        outputs=outputs,
        parameters={"a": 1.0, "d": 1.0, "b": 1.0},
        dynamics=lambda s: {"x": s.v, "v": -s.a * s.x - s.d * s.v + s.b * s.u},
        output=lambda s: {name: getattr(s, name) for name in outputs},
    )


def draw(seed: int) -> World:
    """The world of a seed."""
    rng = np.random.default_rng([seed, 54])
    kind, truth, held_out = (str(rng.choice(names)) for names in (KINDS, TRUTHS, HELD_OUT))
    base, pace = model_of(kind), 10.0 ** rng.uniform(-0.5, 0.5)
    true = _values(kind, rng, pace)
    off = 0.0 if truth == "exact" else _STATED * rng.choice([0.5, 1.0, 4.0])
    given = {name: value * float(np.exp(off * rng.normal())) for name, value in true.items()}
    stated = {name: _STATED * abs(value) for name, value in given.items()}
    model = replace(base, nominal=given, prior_std=stated)
    step, samples = 0.08 / pace, int(rng.integers(150, 300))
    beside, size = _beside(truth), float(rng.uniform(0.15, 0.6))
    flights = []
    for number in range(3):
        other = number == 2 and held_out == "other"
        amplitude = 2.5 if number == 2 and held_out == "larger" else 1.0
        t = step * np.arange(samples)
        inputs = {name: amplitude * _input(rng, t, pace) for name in base.inputs}
        values = {name: value * (1.4 if other else 1.0) for name, value in true.items()}
        flights.append((t, inputs, _flown(kind, values, inputs, step, beside, size)))
    scale = {name: float(np.std(flights[0][2][name])) or 1.0 for name in base.outputs}
    level, colour = 10.0 ** rng.uniform(-2.5, -1.0), float(rng.choice([0.0, 0.0, 0.7]))
    noise = {name: level * scale[name] for name in base.outputs}
    records = [
        Record(
            name=f"m{number}",
            t=t,
            channels={
                **inputs,
                **{name: read[name] + noise[name] * _noise(rng, len(t), colour) for name in base.outputs},
            },
        )
        for number, (t, inputs, read) in enumerate(flights, 1)
    ]
    return World(
        kind=kind,
        truth=truth,
        held_out=held_out,
        model=model,
        records=tuple(records[:2]),
        held=records[2],
        exact=tuple(name for name in ("x",) if kind != "lag"),
        clean=flights[2][2],
        noise=noise,
    )


def as_given(world: World) -> dict[str, np.ndarray]:
    """Readings of the held-out record by the model as given, from the state at rest, without noise."""
    step = float(world.held.t[1] - world.held.t[0])
    inputs = {name: world.held[name] for name in world.model.inputs}
    return _flown(world.kind, dict(world.model.nominal), inputs, step, _beside("exact"), 0.0)


def _values(kind: str, rng: np.random.Generator, pace: float) -> dict[str, float]:
    """True values: stable, some of them lightly damped."""
    gain, damping = 10.0 ** rng.uniform(-0.5, 0.5), rng.choice([0.05, 0.3, 0.8])
    if kind == "lag":
        return {"a": pace, "b": gain * pace}
    swing = {"a": pace**2, "d": 2.0 * float(damping) * pace, "b": gain * pace**2}
    return swing | ({"c": 0.7 * pace, "e": pace} if kind == "pair" else {})


_Beside = Callable[[dict[str, np.ndarray], dict[str, np.ndarray], float], tuple[dict[str, np.ndarray], np.ndarray]]


def _beside(truth: str) -> _Beside:
    """What the truth has beside the model: the inputs as they act, and what is added to the rate that they drive."""

    def acts(x: dict[str, np.ndarray], u: dict[str, np.ndarray], size: float):
        first, second = x["x"], x.get("v", x["x"])
        now, added = dict(u), np.zeros_like(first)
        if truth == "square":
            added = -size * first * np.abs(first)
        elif truth == "cube":
            added = -size * first**3
        elif truth == "friction":
            added = -size * np.tanh(20.0 * second)
        elif truth == "dead zone":
            now["u"] = np.sign(u["u"]) * np.maximum(np.abs(u["u"]) - size, 0.0)
        elif truth == "saturation":
            now["u"] = np.clip(u["u"], -1.5 * size, 1.5 * size)
        elif truth == "feedback":
            now["u"] = u["u"] - size * second
        return now, added

    return acts


def _flown(
    kind: str, p: dict[str, float], inputs: dict[str, np.ndarray], step: float, beside: _Beside, size: float
) -> dict[str, np.ndarray]:
    """Readings of a flight from rest, by Runge-Kutta steps of fourth order with linear inputs between samples."""
    names = {"lag": ("x",), "pair": ("x", "v", "y")}.get(kind, ("x", "v"))
    samples = len(next(iter(inputs.values())))
    X, h = np.zeros((samples, len(names))), step / _FINER

    def rate(x: np.ndarray, u: dict[str, np.ndarray]) -> np.ndarray:
        state = dict(zip(names, x, strict=True))
        act, added = beside(state, u, size)
        push = p["b"] * act["u"] + added * p["b"]
        if kind == "lag":
            return np.array([-p["a"] * state["x"] + push])
        swing = [state["v"], -p["a"] * state["x"] - p["d"] * state["v"] + push]
        further = [-p["c"] * state["y"] + p["e"] * u["w"] + 0.3 * state["x"]] if kind == "pair" else []
        return np.array([*swing, *further])

    for k in range(samples - 1):
        x = X[k].copy()
        for j in range(_FINER):
            begin, middle, end = (
                {n: v[k] + (v[k + 1] - v[k]) * part / _FINER for n, v in inputs.items()} for part in (j, j + 0.5, j + 1)
            )
            k1 = rate(x, begin)
            k2 = rate(x + 0.5 * h * k1, middle)
            k3 = rate(x + 0.5 * h * k2, middle)
            k4 = rate(x + h * k3, end)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        X[k + 1] = x
    read = {name: X[:, i] for i, name in enumerate(names)}
    return read | ({"z": read["x"] + read["y"]} if kind == "pair" else {})


def _input(rng: np.random.Generator, t: np.ndarray, pace: float) -> np.ndarray:
    """Steps of random length and size, with short ramps, from zero."""
    edges, level = np.cumsum(rng.uniform(0.5, 3.0, size=60)) / pace, rng.uniform(-1.0, 1.0, size=61)
    held = np.r_[0.0, level[1:]][np.searchsorted(edges, t)]
    return np.convolve(np.pad(held, 2, "edge"), np.ones(5) / 5.0, "valid")


def _noise(rng: np.random.Generator, samples: int, colour: float) -> np.ndarray:
    """Noise of unit variance, of a first-order autoregression."""
    white = rng.normal(size=samples)
    found = white.copy()
    for k in range(1, samples):
        found[k] = colour * found[k - 1] + np.sqrt(1.0 - colour**2) * white[k]
    return found
