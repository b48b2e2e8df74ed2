"""Problems that newcomers pose: three dozen, published or drawn, each from three starts, with the settings by default.

Published readings: Barnes' predator and prey (van Domselaar and Hemker, NW 18/75, Mathematisch Centrum, 1975), lynx and
hare (Hudson's Bay Company, 1900 to 1920, as in Stan's case studies), influenza in a boarding school (BMJ, 4 March
1978), Rooney and Biegler (AIChE J. 47, 2001), third order (APMonitor, Dynamic Parameter Estimation, example 4), and
those of `differential.py`. The others are drawn by a seed from textbook models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.estimation import Fit, InitialState, Problem
from casid.formats.petab import read_petab
from casid.model.simulate import simulate
from casid.model.system import Model, define_model, define_regression
from casid.records.record import Record
from problems.references.differential import PUBLISHED
from problems.references.goodwin import goodwin
from problems.references.petab import Likelihood, times

FACTORS = (1.0, 0.7, 1.6)  # of every parameter of a start; where a start is zero, and of every other one, inversely
_TOLERANCES = (1e-10, 1e-8)  # of LSODA
_NOISE = 0.03  # of a channel's range, of drawn readings


@dataclass(frozen=True, eq=False, kw_only=True)
class Posed:
    """`make()` is the problem from its own start; `judged` whether LSODA can simulate it."""

    name: str
    make: Callable[[], Problem]
    judged: bool = True

    def starts(self) -> list[Problem]:
        """From its own start and from others."""
        problem = self.make()
        return [problem, *(_moved(problem, factor) for factor in FACTORS[1:])]


def by_lsoda(problem: Problem, fit: Fit) -> float:
    """-ln(likelihood) of the estimates, initial states and noise of a fit, by LSODA's motion."""
    noise = fit.noise if problem.noise is None else problem.noise
    begins = np.array([fit.states[record.name].trajectory[0] for record in problem.records])
    held = replace(problem, noise=noise)
    # a stiff motion does not end with the smaller tolerance
    found = (Likelihood(held, tolerance)(fit.values, begins) for tolerance in _TOLERANCES)
    return next((value for value in found if np.isfinite(value)), math.inf)


def posed(data: Path | None) -> Iterator[Posed]:
    """All of them; those whose readings lie in a folder `data` where that is given."""
    for make in (_barnes, _lynx, _influenza, _third_order):
        yield Posed(name=make.__name__[1:].replace("_", " "), make=make)
    yield Posed(name="Rooney and Biegler", make=_rooney, judged=False)
    yield Posed(name="Goodwin", make=lambda: goodwin(1.3))
    for name, draw in DRAWN.items():
        yield Posed(name=name, make=draw)
    for published in PUBLISHED:
        if data is not None and (not published.file or (data / "references" / published.file).is_file()):
            own = published.make
            yield Posed(name=published.name, make=lambda own=own: own(data / "references"))
    for name in ("Elowitz_Nature2000", "Perelson_Science1996", "Rahman_MBS2016"):
        file = data and data / "petab" / name / f"{name}.yaml"
        if file and file.is_file():
            yield Posed(name=name, make=lambda file=file: read_petab(file))


def _moved(problem: Problem, factor: float) -> Problem:
    """From a start of which every other parameter is larger, and smaller; zeros become a tenth of it."""
    names, start = problem.parameters, problem.start_vector
    turned = [factor if i % 2 == 0 else 1.0 / factor for i in range(len(names))]
    off = np.where(start == 0.0, 0.1 * np.array(turned), start * turned)
    return times(replace(problem, start=dict(zip(names, off.tolist(), strict=True))), 1.0)


def _posed(model: Model, t: Any, read: Mapping[str, Any], start: Mapping[str, float] | None = None, **more) -> Problem:
    channels = {name: np.asarray(values, dtype=float) for name, values in read.items()}
    record = Record(name="r", t=np.asarray(t, dtype=float), channels=channels)
    return Problem(model, [record], free=["*"], start=dict(start or {}), **more)


def _system(name: str, states: str, parameters: Mapping[str, float], rates: Callable[[Any], tuple], **more) -> Model:
    """Of states by their letters, all of them outputs unless `more` says others."""
    names = states.split()
    own: dict[str, Any] = {"inputs": (), "outputs": names, "output": lambda s: {x: getattr(s, x) for x in names}}
    own |= {"dynamics": lambda s: dict(zip(names, rates(s), strict=True))}
    return define_model(name, states=names, parameters=parameters, **{**own, **more})


def _barnes() -> Problem:
    a = [1, 1.1, 1.3, 1.1, 0.9, 0.7, 0.5, 0.6, 0.7, 0.8, 1]
    b = [0.3, 0.35, 0.4, 0.5, 0.5, 0.4, 0.3, 0.25, 0.25, 0.3, 0.35]
    ones: dict[str, float] = dict.fromkeys(("k1", "k2", "k3"), 1.0)
    model = _system("Barnes", "a b", ones, lambda s: (s.k1 * s.a - s.k2 * s.a * s.b, s.k2 * s.a * s.b - s.k3 * s.b))
    known = InitialState(value={"a": 1.0, "b": 0.3}, std={"a": 0.0, "b": 0.0})
    return _posed(model, np.arange(11) / 2, {"a": a, "b": b}, noise={"a": 0.1, "b": 0.1}, initial_state=known)


def _lynx() -> Problem:
    hare = [30, 47.2, 70.2, 77.4, 36.3, 20.6, 18.1, 21.4, 22, 25.4, 27.1, 40.3, 57, 76.6, 52.3, 19.5, 11.2, 7.6, 14.6]
    lynx = [4, 6.1, 9.8, 35.2, 59.4, 41.7, 19, 13, 8.3, 9.1, 7.4, 8, 12.3, 19.5, 45.7, 51.1, 29.7, 15.8, 9.7]
    rates = {"a": 0.5, "b": 0.02, "c": 0.8, "d": 0.02}
    model = _system("lynx and hare", "h l", rates, lambda s: (s.a * s.h - s.b * s.h * s.l, s.d * s.h * s.l - s.c * s.l))
    read = {"h": [*hare, 16.2, 24.7], "l": [*lynx, 10.1, 8.6]}
    return _posed(model, np.arange(21), read)


def _influenza() -> Problem:
    ill = [3, 8, 26, 76, 225, 298, 258, 233, 189, 128, 68, 29, 14, 4]
    model = _system(
        "influenza",
        "S I",
        {"beta": 2.0, "gamma": 0.5},
        lambda s: (-s.beta * s.S * s.I / 763.0, s.beta * s.S * s.I / 763.0 - s.gamma * s.I),
        outputs=["ill"],
        output=lambda s: {"ill": s.I},
    )
    known = InitialState(value={"S": 762.0, "I": 1.0}, std={"S": 0.0, "I": 0.0})
    return _posed(model, np.arange(14), {"ill": ill}, initial_state=known)


def _third_order() -> Problem:
    t = [0, 0.1, 0.2, 0.4, 0.8, 1, 1.5, 2, 2.5, 3, 3.5, 4]
    x = [2.0, 1.6, 1.2, 0.7, 0.3, 0.15, 0.1, 0.05, 0.03, 0.02, 0.015, 0.01]
    model = _system(
        "third order",
        "x y z",
        dict.fromkeys("abcd", 0.0),
        lambda s: (s.y, s.z, s.a * s.z + s.b * s.y + s.c * s.x + s.d),
        outputs=["x"],
        output=lambda s: {"x": s.x},
    )
    return _posed(model, t, {"x": x}, initial_state=InitialState(value={"x": 2.0}, std={"x": 0.0}))


def _rooney() -> Problem:
    model = define_regression(
        "Rooney and Biegler",
        inputs=("h",),
        parameters={"theta": 10.0, "rate": 1.0},
        outputs=("y",),
        output=lambda s: {"y": s.theta * (1 - np.exp(-s.rate * s.h))},
    )
    return _posed(model, np.arange(6), {"h": [1, 2, 3, 4, 5, 7], "y": [8.3, 10.3, 19, 16, 15.6, 19.8]})


def _drawn(
    model: Model, t: np.ndarray, begin: list[float], seed: int, forced: np.ndarray | None = None, **more: Any
) -> Problem:
    """Readings of the model at its nominal values with noise, to be estimated, from a start that is off by a third. An
    output whose name does not begin with the letter o is read."""
    inputs = {} if forced is None else {"u": forced}
    exact = simulate(model, Record(name="r", t=t, channels=inputs), begin, {}, integrator="cvodes").as_record()
    rng = np.random.default_rng(seed)
    read = {o: exact[o] + _NOISE * np.ptp(exact[o]) * rng.standard_normal(len(t)) for o in model.outputs}
    start = {n: v * 1.35 ** (-1) ** i for i, (n, v) in enumerate(model.nominal.items())}
    return _posed(model, t, read | inputs, start, **more)


def _one(name: str) -> dict[str, Any]:
    return {"outputs": ["seen"], "output": lambda s: {"seen": getattr(s, name)}}


def _steps(t: np.ndarray, seed: int) -> np.ndarray:
    """Levels that change every tenth of a record."""
    levels = np.random.default_rng(seed).standard_normal(10)
    return levels[np.minimum((10 * (t - t[0]) / (t[-1] - t[0])).astype(int), 9)]


def _decay(size: float, output: str) -> Problem:
    more = _one("x") if output == "seen" else {}
    return _drawn(_system("decay", "x", {"k": 0.3}, lambda s: (-s.k * s.x,), **more), np.linspace(0, 10, 41), [size], 0)


def _fitzhugh() -> Problem:
    model = _system(
        "FitzHugh-Nagumo",
        "V R",
        {"a": 0.2, "b": 0.2, "c": 3.0},
        lambda s: (s.c * (s.V - s.V**3 / 3 + s.R), -(s.V - s.a + s.b * s.R) / s.c),
    )
    return _drawn(model, np.linspace(0, 20, 201), [-1.0, 1.0], 1)


def _lorenz() -> Problem:
    model = _system(
        "Lorenz",
        "x y z",
        {"s": 10.0, "r": 28.0, "b": 8 / 3},
        lambda s: (s.s * (s.y - s.x), s.x * (s.r - s.z) - s.y, s.x * s.y - s.b * s.z),
        **_one("x"),
    )
    return replace(
        _drawn(model, np.linspace(0, 8, 401), [-11.8, -5.1, 10.0], 2), start={"s": 11.0, "r": 26.0, "b": 2.9}
    )


def _van_der_pol(mu: float) -> Problem:
    model = _system("van der Pol", "x v", {"mu": mu}, lambda s: (s.v, s.mu * (1 - s.x**2) * s.v - s.x))
    return _drawn(model, np.linspace(0, 30, 301), [2.0, 0.0], 3)


def _pendulum() -> Problem:
    model = _system(
        "pendulum", "a w", {"k": 9.81, "d": 0.3}, lambda s: (s.w, -s.k * np.sin(s.a) - s.d * s.w), **_one("a")
    )
    return _drawn(model, np.linspace(0, 10, 201), [2.5, 0.0], 4)


def _duffing() -> Problem:
    t = np.linspace(0, 20, 801)
    model = _system(
        "Duffing",
        "x v",
        {"k": 9.0, "d": 0.2, "h": 4.0, "g": 5.0},
        lambda s: (s.v, s.g * s.u - s.k * s.x - s.d * s.v - s.h * s.x**3),
        inputs=["u"],
        **_one("x"),
    )
    return _drawn(model, t, [0.0, 0.0], 5, np.sin(2.0 * t + 0.06 * t**2))


def _resonance() -> Problem:
    t = np.linspace(0, 10, 1001)
    model = _system(
        "resonance",
        "x v",
        {"k": 400.0, "d": 0.6, "g": 300.0},
        lambda s: (s.v, s.g * s.u - s.k * s.x - s.d * s.v),
        inputs=["u"],
        **_one("x"),
    )
    return _drawn(model, t, [0.0, 0.0], 6, _steps(t, 6))


def _friction() -> Problem:
    t = np.linspace(0, 10, 501)
    model = _system(
        "dry friction",
        "x v",
        {"k": 4.0, "mu": 0.3, "g": 2.0},
        lambda s: (s.v, s.g * s.u - s.k * s.x - s.mu * np.sign(s.v)),
        inputs=["u"],
    )
    return _drawn(model, t, [0.5, 0.0], 7, np.sin(1.7 * t) + 0.5 * np.sin(0.6 * t))


def _motor() -> Problem:
    t = np.linspace(0, 4, 401)
    model = _system(
        "motor",
        "i w",
        {"R": 1.2, "L": 0.05, "K": 0.4, "J": 0.02, "b": 0.01},
        lambda s: ((s.u - s.R * s.i - s.K * s.w) / s.L, (s.K * s.i - s.b * s.w) / s.J),
        inputs=["u"],
    )
    return _drawn(model, t, [0.0, 0.0], 8, _steps(t, 8))


def _tanks() -> Problem:
    t = np.linspace(0, 200, 201)
    model = _system(
        "two tanks",
        "a b",
        {"k1": 0.25, "k2": 0.2, "g": 0.3},
        lambda s: (s.g * s.u - s.k1 * np.sqrt(s.a), s.k1 * np.sqrt(s.a) - s.k2 * np.sqrt(s.b)),
        inputs=["u"],
    )
    return _drawn(model, t, [4.0, 4.0], 9, 2.0 + 0.5 * _steps(t, 9))


def _brusselator() -> Problem:
    model = _system(
        "Brusselator",
        "x y",
        {"A": 1.0, "B": 3.0},
        lambda s: (s.A + s.x**2 * s.y - (s.B + 1) * s.x, s.B * s.x - s.x**2 * s.y),
    )
    return _drawn(model, np.linspace(0, 20, 201), [1.0, 1.0], 10)


def _robertson() -> Problem:
    model = _system(
        "Robertson",
        "a b c",
        {"k1": 0.04, "k2": 3e7, "k3": 1e4},
        lambda s: (
            -s.k1 * s.a + s.k3 * s.b * s.c,
            s.k1 * s.a - s.k3 * s.b * s.c - s.k2 * s.b**2,
            s.k2 * s.b**2,
        ),
        initial=lambda _: {"a": 1.0, "b": 0.0, "c": 0.0},
    )
    return _drawn(model, np.r_[0.0, np.logspace(-3, 4, 41)], [1.0, 0.0, 0.0], 11, log=["*"])


def _oregonator() -> Problem:
    names = {"lx": "x", "ly": "y", "lz": "z"}
    model = _system(
        "Oregonator",
        "x y z",
        {"q": 8.375e-6, "w": 0.161},
        lambda s: (
            77.27 * (s.y + s.x * (1 - s.q * s.x - s.y)),
            (s.z - (1 + s.x) * s.y) / 77.27,
            s.w * (s.x - s.z),
        ),
        outputs=list(names),
        output=lambda s: {o: np.log10(getattr(s, x)) for o, x in names.items()},
        initial=lambda _: {"x": 1.0, "y": 2.0, "z": 3.0},
    )
    return _drawn(model, np.linspace(0, 120, 121), [1.0, 2.0, 3.0], 12, log=["*"])


def _enzyme() -> Problem:
    model = _system(
        "enzyme",
        "S P",
        {"V": 1.0, "K": 0.5},
        lambda s: (-s.V * s.S / (s.K + s.S), s.V * s.S / (s.K + s.S)),
        **_one("P"),
    )
    known = InitialState(value={"P": 0.0}, std={"P": 0.0})
    return _drawn(model, np.linspace(0, 6, 31), [3.0, 0.0], 13, initial_state=known)


def _growth() -> Problem:
    model = _system("logistic growth", "n", {"r": 0.8, "K": 1e6}, lambda s: (s.r * s.n * (1 - s.n / s.K),))
    return _drawn(model, np.linspace(0, 15, 16), [1e4], 14)


def _epidemic() -> Problem:
    model = _system(
        "epidemic",
        "S E I",
        {"beta": 0.9, "sigma": 0.3, "gamma": 0.2},
        lambda s: (-s.beta * s.S * s.I, s.beta * s.S * s.I - s.sigma * s.E, s.sigma * s.E - s.gamma * s.I),
        **_one("I"),
    )
    known = InitialState(value={"S": 0.999, "E": 0.0, "I": 0.001}, std=dict.fromkeys("SEI", 0.0))
    return _drawn(model, np.arange(60.0), [0.999, 0.0, 0.001], 15, initial_state=known)


def _insulin() -> Problem:
    t = np.array([0, 2, 4, 6, 8, 10, 12, 14, 16, 19, 22, 27, 32, 42, 52, 62, 72, 82, 92, 102, 122, 142, 162, 182.0])
    model = _system(
        "Bergman",
        "G X",
        {"p1": 0.03, "p2": 0.02, "p3": 1.0e-5, "G0": 280.0},
        lambda s: (-(s.p1 + s.X) * s.G + s.p1 * 92.0, -s.p2 * s.X + s.p3 * s.u),
        inputs=["u"],
        initial=lambda s: {"G": s.G0, "X": 0.0},
        **_one("G"),
    )
    return _drawn(model, t, [280.0, 0.0], 16, 120.0 * np.exp(-t / 8.0) + 20.0 * np.exp(-t / 80.0))


def _reactor() -> Problem:
    t = np.linspace(0, 10, 101)
    model = _system(
        "reactor",
        "c T",
        {"k0": 2.0, "E": 1.5, "h": 1.2, "U": 0.8},
        lambda s: (
            1.0 - s.c - s.k0 * np.exp(-s.E / s.T) * s.c,
            1.0 - s.T + s.h * s.k0 * np.exp(-s.E / s.T) * s.c + s.U * (s.u - s.T),
        ),
        inputs=["u"],
    )
    return _drawn(model, t, [0.8, 1.2], 17, 1.0 + 0.2 * _steps(t, 17))


def _chain() -> Problem:
    model = _system(
        "A to B to C",
        "A B C",
        {"k1": 1.0, "k2": 0.4},
        lambda s: (-s.k1 * s.A, s.k1 * s.A - s.k2 * s.B, s.k2 * s.B),
        **_one("B"),
    )
    return _drawn(model, np.linspace(0, 10, 21), [5.0, 0.0, 0.0], 18)


def _calcium() -> Problem:
    model = _system(
        "repressilator",
        "a b c",
        {"k": 5.0, "n": 3.0, "d": 1.0},
        lambda s: tuple(s.k / (1 + other**s.n) - s.d * own for own, other in ((s.a, s.c), (s.b, s.a), (s.c, s.b))),
    )
    return _drawn(model, np.linspace(0, 15, 151), [1.0, 1.5, 2.0], 19)


def _unstable() -> Problem:
    t = np.linspace(0, 6, 301)
    model = _system(
        "unstable short period",
        "a q",
        {"Za": -0.8, "Ma": 2.0, "Mq": -0.6, "Md": -6.0},
        lambda s: (s.Za * s.a + s.q, s.Ma * s.a + s.Mq * s.q + s.Md * s.u),
        inputs=["u"],
    )
    return _drawn(model, t, [0.0, 0.0], 20, 0.02 * _steps(t, 20))


DRAWN: dict[str, Callable[[], Problem]] = {
    "decay from 1e5": lambda: _decay(1e5, "x"),
    "decay from 1e5, another name": lambda: _decay(1e5, "seen"),
    "decay from 1e-6, another name": lambda: _decay(1e-6, "seen"),
    "FitzHugh-Nagumo": _fitzhugh,
    "Lorenz": _lorenz,
    "van der Pol": lambda: _van_der_pol(1.0),
    "van der Pol, stiff": lambda: _van_der_pol(20.0),
    "pendulum": _pendulum,
    "Duffing": _duffing,
    "resonance": _resonance,
    "dry friction": _friction,
    "motor": _motor,
    "two tanks": _tanks,
    "Brusselator": _brusselator,
    "Robertson": _robertson,
    "Oregonator": _oregonator,
    "enzyme": _enzyme,
    "logistic growth": _growth,
    "epidemic": _epidemic,
    "Bergman": _insulin,
    "reactor": _reactor,
    "A to B to C": _chain,
    "repressilator": _calcium,
    "unstable short period": _unstable,
}
