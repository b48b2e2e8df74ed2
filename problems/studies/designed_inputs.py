"""Experiments for which inputs are designed, and what flying them many times gives: Do 328, one plane of motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from casid.design import Experiment, InputDesign
from casid.estimation import Problem, solve
from casid.model.dynamics import aircraft_model
from casid.model.trim import trim
from casid.report import looks
from casid.report.figure import Axis, Bar, Curve, Figure, Panel, Part, Picture, Rule
from casid.report.looks import Look
from problems.do328 import THRUST, V_TRIM, do328

NOISE = MappingProxyType(
    {
        "alpha": 0.003,
        "beta": 0.003,
        "p": 0.002,
        "q": 0.002,
        "r": 0.002,
        "phi": 0.005,
        "theta": 0.005,
        "az": 0.1,
        "ay": 0.1,
    }
)
START_FACTOR = 0.8  # of the truth, from which each estimation starts


def _experiment(
    axes: str,
    outputs: tuple[str, ...],
    surfaces: Mapping[str, float],
    limits: Mapping[str, float],
    duration: float,
    parameters: tuple[str, ...],
) -> Experiment:
    model = aircraft_model(do328(), axes=axes, outputs=outputs, effects=())
    at = trim(do328(), V=V_TRIM, thrust=THRUST)
    whole = aircraft_model(do328(), effects=())
    known = dict(zip(whole.states, at.state.tolist(), strict=True)) | at.inputs
    return Experiment(
        model=model,
        surfaces=surfaces,
        rest={name: known[name] for name in model.inputs},
        start=np.array([known[name] for name in model.states]),
        noise={name: NOISE[name] for name in outputs},
        duration=duration,
        dt=0.04,
        parameters=parameters,
        limits=limits,
    )


def longitudinal() -> Experiment:
    """Elevator within 3.4 deg, angle of attack within 2.3 deg and specific force within 0.6 g of trim, 10 s."""
    return _experiment(
        "longitudinal",
        ("alpha", "q", "theta", "az"),
        {"delta_e": 0.06},
        {"alpha": 0.04, "az": 6.0},
        10.0,
        ("CL_0", "CL_alpha", "Cm_*"),
    )


def lateral() -> Experiment:
    """Aileron and rudder within 2.9 deg, sideslip within 4 deg, bank within 40 deg, 15 s."""
    return _experiment(
        "lateral",
        ("beta", "p", "r", "phi", "ay"),
        {"delta_a": 0.05, "delta_r": 0.05},
        {"beta": 0.07, "phi": 0.7},
        15.0,
        ("CY_beta", "Cl_[!0]*", "Cn_[!0]*"),
    )


EXPERIMENTS: Mapping[str, Callable[[], Experiment]] = MappingProxyType(
    {"longitudinal": longitudinal, "lateral": lateral}
)


def flown(experiment: Experiment, design: InputDesign, runs: int, seed: int) -> np.ndarray:
    """(runs that converged, parameters) estimates from as many flights of a design, noise drawn anew for each."""
    model, found = experiment.model, []
    truth = dict(zip(model.parameters, model.nominal_vector(experiment.values).tolist(), strict=True))
    start = {name: START_FACTOR * truth[name] for name in experiment.free}
    for run in range(runs):
        rng, record = np.random.default_rng([seed, run]), design.record
        drawn = {n: record[n] + s * rng.standard_normal(len(record)) for n, s in experiment.noise.items()}
        problem = Problem(
            model, [record.with_channels(**drawn)], free=experiment.free, start=start, noise=experiment.noise
        )
        fit = solve(problem)
        if fit.converged:
            found.append([fit.values[name] for name in experiment.free])
    return np.reshape(found, (-1, len(experiment.free)))


def volume(estimates: np.ndarray, sizes: np.ndarray, criterion: str = "D") -> float:
    """Logarithm of the relative scatter in the mean over all parameters: geometric over the axes of its ellipsoid for
    "D" (half the log determinant of its covariance per parameter), root mean square for "A"."""
    covariance = np.cov((estimates / sizes).T)
    if criterion == "D":
        return float(0.5 * np.linalg.slogdet(covariance)[1] / len(sizes))
    return float(0.5 * np.log(np.trace(covariance) / len(sizes)))


def volume_std(estimates: np.ndarray, sizes: np.ndarray, criterion: str = "D") -> float:
    """Standard deviation of `volume` from so many runs, of normal estimates, to first order."""
    if criterion == "D":
        return float(1.0 / np.sqrt(2.0 * len(estimates) * len(sizes)))
    covariance = np.cov((estimates / sizes).T)
    # few parameters may dominate the trace: var tr S = 2 tr(S^2)/n
    return float(np.sqrt((covariance**2).sum() / (2.0 * len(estimates))) / np.trace(covariance))


def scatter_bars(name: str, parameters: Sequence[str], ratios: Mapping[str, Sequence[tuple[float, float]]]) -> Picture:
    """(measured, predicted) scatter over that of the standard input, per design and parameter."""
    at = np.arange(len(parameters))
    height = 0.8 / len(ratios)
    parts: list[Part] = [Rule(look=Look(colour=looks.INK, width=1.0), at=1.0)]
    for k, (title, pairs) in enumerate(ratios.items()):
        places = at + 0.8 * ((k + 0.5) / len(ratios) - 0.5)
        look = looks.each(k + 1, title)
        parts += [Bar(look=look, at=y, low=0.0, high=m, height=height) for y, (m, _) in zip(places, pairs, strict=True)]
        mark = Look(colour=looks.INK, dash="", marker="|", size=8.0)
        parts.append(Curve(look=mark, x=np.array([p for _, p in pairs]), y=places))
    panel = Panel(
        parts=tuple(parts),
        x=Axis(label="scatter of the estimates over that of the standard 3-2-1-1", low=0.0),
        y=Axis(names=tuple(parameters)),
        height=0.28 * len(parameters) + 0.2,
    )
    return Picture(
        name=f"{name}_scatter",
        figure=Figure(rows=((panel,),)),
        title=f"What it gains, {name}",
        caption="Bars: measured in simulated flights. Marks: predicted by the bound.",
        alt="Bars of the scatter of each parameter relative to the standard 3-2-1-1.",
    )
