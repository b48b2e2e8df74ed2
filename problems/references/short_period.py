"""An aircraft's short period as a PEtab problem, with a solution on paper.

Angle of attack and pitch rate are read 10 times a second in two flights, each with a 3-2-1-1 of the elevator from trim.
The motion is linear and the elevator constant between its steps, so that matrix exponentials give it exactly; SBML,
tables and readings are written from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

# 1/s, 1/s2 and rad, of a light transport; the bias of the vane, and 1-sigma of the noise [rad, rad/s]
TRUTH = {
    "Z_alpha": -1.1,
    "Z_delta": -0.12,
    "M_alpha": -5.5,
    "M_q": -1.6,
    "M_delta": -7.0,
    "bias": 0.01,
    "sigma_alpha": 0.004,
    "sigma_q": 0.008,
}
FLIGHTS = {"first": (0.04, 0.5), "second": (-0.03, 0.8)}  # elevator [rad] and length of the shortest pulse [s]
OUTPUTS = ("alpha", "q")
_TIMES = np.round(0.1 * np.arange(1, 101), 10)  # s
_BEGINS = ((0, 1), (3, -1), (5, 1), (6, -1), (7, 0))  # in pulses, and the sign of the elevator from then on
_BOUNDS = {"sigma_alpha": (1e-5, 1.0), "sigma_q": (1e-5, 1.0)}
_BOUND = 100.0  # either way of every other parameter


def write(folder: Path, seed: int = 0) -> Path:
    """All files of the problem; returns the YAML file."""
    rows = ["observableId\tsimulationConditionId\tmeasurement\ttime"]
    for flight, read in readings(seed).items():
        for output, values in zip(OUTPUTS, read.T, strict=True):
            rows += [f"read_{output}\t{flight}\t{z!r}\t{t}" for z, t in zip(values.tolist(), _TIMES, strict=True)]
    table = ["parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate"]
    for name, value in TRUTH.items():
        low, high = _BOUNDS.get(name, (-_BOUND, _BOUND))
        table.append(f"{name}\t{'log10' if name in _BOUNDS else 'lin'}\t{low}\t{high}\t{value}\t1")
    files = {
        "model.xml": _sbml(),
        "measurements.tsv": "\n".join(rows),
        "parameters.tsv": "\n".join(table),
        "conditions.tsv": "\n".join(
            ["conditionId\televator\tpulse", *(f"{n}\t{size}\t{pulse}" for n, (size, pulse) in FLIGHTS.items())]
        ),
        "observables.tsv": "observableId\tobservableFormula\tnoiseFormula\tnoiseDistribution\n"
        "read_alpha\talpha + bias\tsigma_alpha\tnormal\nread_q\tq\tsigma_q\tnormal",
        "short_period.yaml": "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n"
        "- condition_files: [conditions.tsv]\n  measurement_files: [measurements.tsv]\n"
        "  observable_files: [observables.tsv]\n  sbml_files: [model.xml]",
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text + "\n")
    return folder / "short_period.yaml"


def motion(values: Mapping[str, float], flight: str) -> np.ndarray:
    """(100, 2) angle of attack [rad] and pitch rate [rad/s] at the times of reading, by matrix exponentials."""
    size, pulse = FLIGHTS[flight]
    a = np.array([[values["Z_alpha"], 1.0], [values["M_alpha"], values["M_q"]]])
    b = size * np.array([values["Z_delta"], values["M_delta"]])
    steps = [(pulse * k, sign) for k, sign in _BEGINS]
    grid = np.unique(np.round(np.concatenate([[0.0], _TIMES, [t for t, _ in steps]]), 10))
    x, found = np.array([0.0, 0.0, 1.0]), {}
    for begin, end in zip(grid[:-1], grid[1:], strict=True):
        sign = [s for t, s in steps if t <= 0.5 * (begin + end)][-1]
        x = expm((end - begin) * np.block([[a, sign * b[:, None]], [np.zeros((1, 3))]])) @ x
        found[end] = x[:2]
    return np.array([found[t] for t in _TIMES])


def readings(seed: int) -> dict[str, np.ndarray]:
    """Flight -> (100, 2) readings."""
    rng = np.random.default_rng(seed)
    sigma = np.array([TRUTH["sigma_alpha"], TRUTH["sigma_q"]])
    return {n: _seen(TRUTH, n) + sigma * rng.standard_normal((len(_TIMES), 2)) for n in FLIGHTS}


def _seen(values: Mapping[str, float], flight: str) -> np.ndarray:
    return motion(values, flight) + np.array([values["bias"], 0.0])


def likelihood(values: Mapping[str, float], seed: int = 0) -> float:
    """-ln(likelihood) on paper."""
    sigma = np.array([values["sigma_alpha"], values["sigma_q"]])
    total = 0.0
    for flight, read in readings(seed).items():
        white = (read - _seen(values, flight)) / sigma
        total += float((0.5 * white**2 + np.log(sigma * math.sqrt(2.0 * math.pi))).sum())
    return total


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """Most likely values, and -ln(likelihood) there."""

    values: dict[str, float]
    cost: float


def optimum(seed: int = 0) -> Optimum:
    """By least squares on the motion on paper, in turns with the noise, until neither changes."""
    names, read = list(TRUTH)[:-2], readings(seed)

    def residuals(v: np.ndarray) -> np.ndarray:
        values = dict(zip(names, v, strict=True))
        return np.concatenate([read[n] - _seen(values, n) for n in FLIGHTS])

    found, sigma = np.array([TRUTH[n] for n in names]), np.ones(2)
    before = np.zeros(2)
    while not np.allclose(sigma, before, rtol=1e-9):
        before = sigma
        found = least_squares(
            lambda v, sigma=sigma: (residuals(v) / sigma).ravel(), found, x_scale="jac", xtol=1e-12, ftol=1e-14
        ).x
        sigma = np.sqrt((residuals(found) ** 2).mean(axis=0))
    values = dict(zip(TRUTH, [*found.tolist(), *sigma.tolist()], strict=True))
    return Optimum(values=values, cost=likelihood(values, seed))


def _sbml() -> str:
    """The model; the elevator is an assignment by the time."""
    pieces = ""
    for (_, sign), (end, _) in zip(_BEGINS[:-1], _BEGINS[1:], strict=True):
        value = "<ci>elevator</ci>" if sign > 0 else "<apply><minus/><ci>elevator</ci></apply>"
        until = f"<apply><times/><cn>{end}</cn><ci>pulse</ci></apply>"
        pieces += f"<piece>{value}<apply><lt/>{_TIME}{until}</apply></piece>"
    constants = "".join(
        f'<parameter id="{n}" value="{v}" constant="true"/>'
        for n, v in {**TRUTH, "elevator": 0.0, "pulse": 1.0}.items()
        if not n.startswith("sigma")
    )
    states = "".join(f'<parameter id="{n}" value="0" constant="false"/>' for n in OUTPUTS)
    lift = (
        "<apply><times/><ci>{0}_alpha</ci><ci>alpha</ci></apply><apply><times/><ci>{0}_delta</ci><ci>delta</ci></apply>"
    )
    pitch = "<apply><times/><ci>M_q</ci><ci>q</ci></apply>"
    rules = f'<assignmentRule variable="delta">{_MATH}<piecewise>{pieces}<otherwise><cn>0</cn></otherwise></piecewise>'
    rules += "</math></assignmentRule>"
    for state, parts in {"alpha": lift.format("Z") + "<ci>q</ci>", "q": lift.format("M") + pitch}.items():
        rules += f'<rateRule variable="{state}">{_MATH}<apply><plus/>{parts}</apply></math></rateRule>'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1"><model id="short_period">\n'
        f'<listOfParameters>{constants}{states}<parameter id="delta" constant="false"/></listOfParameters>\n'
        f"<listOfRules>{rules}</listOfRules>\n</model></sbml>"
    )


_MATH = '<math xmlns="http://www.w3.org/1998/Math/MathML">'
_TIME = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol>'
