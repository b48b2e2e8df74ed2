"""Differential equations whose best parameters are published: COPS' four, Bellman's, and two of the PEtab collection.

Sources: Dolan, More and Munson, Benchmarking optimization software with COPS 3.0, ANL/MCS-TM-273 (2004); Bellman et
al., Math. Biosci. 1 (1967); Hass et al., Bioinformatics 35 (2019), for Boehm et al., J. Proteome Res. 13 (2014), and
Bruno et al., J. Exp. Bot. 67 (2016). The data of COPS and PEtab stay outside the project.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casid.estimation import Fit, InitialState, Problem, limit_parameter
from casid.model.system import define_model
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Published:
    """`make(folder)` is the problem from the published start; `figure(fit)` of a fit is what is published as `optimum`,
    "sum of squares" or "-ln L"."""

    name: str
    kind: str
    optimum: float
    make: Callable[[Path], Problem]
    file: str = ""

    def figure(self, fit: Fit) -> float:
        """What a fit reached."""
        return -fit.log_likelihood if self.kind == "-ln L" else sum_of_squares(fit)


# sums of squares
OPTIMA = {
    "alpha-pinene": 19.8721,
    "marine population": 1.97462e7,
    "methanol to hydrocarbons": 9.02229e-3,
    "gas oil cracking": 5.2366e-3,
    "Bellman": 21.867,
}


def sum_of_squares(fit: Fit) -> float:
    """Of all residuals."""
    return float(sum(np.nansum(residuals**2) for residuals in fit.residuals.values()))


def _table(folder: Path, name: str, start: float | None = None) -> Record:
    """A file of COPS, its columns renamed to y0, y1, ...; a row in front where nothing is measured, at time `start`."""
    rows = np.loadtxt(folder / name, delimiter=",", skiprows=1)
    if start is not None and rows[0, 0] > start:
        rows = np.vstack([[start, *[np.nan] * (rows.shape[1] - 1)], rows])
    return Record(name=name[:-4], t=rows[:, 0], channels={f"y{i}": rows[:, i + 1] for i in range(rows.shape[1] - 1)})


def _states(s: Any, count: int) -> list[Any]:
    return [getattr(s, f"x{i}") for i in range(count)]


def _parameters(s: Any, count: int) -> list[Any]:
    return [getattr(s, f"p{i}") for i in range(count)]


def _all_seen(
    name: str, record: Record, start: float, slopes: Callable[[Any], list[Any]], begin: list[float] | None, **more: Any
) -> Problem:
    """Of states x0, x1, ... that are measured as y0, y1, ..., all weighing the same: by the noise that the published
    optimum leaves, as steps of the motion are chosen by it."""
    n, count = len(record.channels), more.pop("parameters")
    samples = sum(int(np.isfinite(y).sum()) for y in record.channels.values())
    sigma = float(np.sqrt(OPTIMA[name] / samples))
    model = define_model(
        name,
        states=[f"x{i}" for i in range(n)],
        inputs=(),
        parameters=dict.fromkeys((f"p{i}" for i in range(count)), start),
        outputs=[f"y{i}" for i in range(n)],
        dynamics=lambda s: {f"x{i}": slope for i, slope in enumerate(slopes(s))},
        output=lambda s: {f"y{i}": x for i, x in enumerate(_states(s, n))},
        state_scale={f"x{i}": float(np.nanmax(record[f"y{i}"])) for i in range(n)},
        initial=None if begin is None else lambda _: {f"x{i}": value for i, value in enumerate(begin)},
    )
    return Problem(model, [record], free=["*"], noise={f"y{i}": sigma for i in range(n)}, **more)


def _pinene(s: Any) -> list[Any]:
    x, p = _states(s, 5), _parameters(s, 5)
    return [
        -(p[0] + p[1]) * x[0],
        p[0] * x[0],
        p[1] * x[0] - (p[2] + p[3]) * x[2] + p[4] * x[4],
        p[2] * x[2],
        p[3] * x[2] - p[4] * x[4],
    ]


def pinene(folder: Path) -> Problem:
    """Isomerisation of alpha-pinene, eight samples."""
    record = _table(folder, "cops_pinene.csv", start=0.0)
    return _all_seen("alpha-pinene", record, 1e-5, _pinene, [100.0, 0.0, 0.0, 0.0, 0.0], parameters=5)


def _marine(s: Any) -> list[Any]:
    x, growth, loss = _states(s, 8), _parameters(s, 15)[:7], _parameters(s, 15)[7:]
    into = [0.0, *(g * x[i] for i, g in enumerate(growth))]
    return [into[i] - (loss[i] + (growth[i] if i < 7 else 0.0)) * x[i] for i in range(8)]


def marine(folder: Path) -> Problem:
    """A marine population in eight stages; its initial state is free."""
    free = InitialState(std={f"x{i}": 1e9 for i in range(8)})
    limits = [limit_parameter(f"p{i}", lower=0.0) for i in range(15)]
    record = _table(folder, "cops_marine.csv")
    return _all_seen(
        "marine population", record, 0.0, _marine, None, parameters=15, initial_state=free, constraints=limits
    )


def _methanol(s: Any) -> list[Any]:
    x, p = _states(s, 3), _parameters(s, 5)
    d = (p[1] + p[4]) * x[0] + x[1]
    return [
        -(2 * p[1] - p[0] * x[1] / d + p[2] + p[3]) * x[0],
        p[0] * x[0] * (p[1] * x[0] - x[1]) / d + p[2] * x[0],
        p[0] * x[0] * (x[1] + p[4] * x[0]) / d + p[3] * x[0],
    ]


def methanol(folder: Path) -> Problem:
    """Methanol to hydrocarbons."""
    limits = [limit_parameter(f"p{i}", lower=0.0) for i in range(5)]
    record = _table(folder, "cops_methanol.csv")
    return _all_seen(
        "methanol to hydrocarbons", record, 1.0, _methanol, [1.0, 0.0, 0.0], parameters=5, constraints=limits
    )


def _gas_oil(s: Any) -> list[Any]:
    (x, y), (p, q, r) = _states(s, 2), _parameters(s, 3)
    return [-(p + r) * x**2, p * x**2 - q * y]


def gas_oil(folder: Path) -> Problem:
    """Catalytic cracking of gas oil."""
    return _all_seen("gas oil cracking", _table(folder, "cops_gasoil.csv"), 0.0, _gas_oil, [1.0, 0.0], parameters=3)


_BELLMAN = (
    (0, 1, 2, 3, 4, 5, 6, 7, 9, 11, 14, 19, 24, 29, 39),
    (0, 1.4, 6.3, 10.5, 14.2, 17.6, 21.4, 23, 27, 30.5, 34.4, 38.8, 41.6, 43.5, 45.3),
)


def bellman(_: Path) -> Problem:
    """Oxidation of nitric oxide."""
    t, y = np.array(_BELLMAN, dtype=float)
    model = define_model(
        "Bellman",
        states=["x"],
        inputs=(),
        parameters={"p0": 1e-6, "p1": 1e-4},
        outputs=["y"],
        dynamics=lambda s: {"x": s.p0 * (126.2 - s.x) * (91.9 - s.x) ** 2 - s.p1 * s.x**2},
        output=lambda s: {"y": s.x},
        state_scale={"x": 45.0},
        initial=lambda _: {"x": 0.0},
    )
    return Problem(
        model,
        [Record(name="bellman", t=t, channels={"y": y})],
        free=["*"],
        noise={"y": float(np.sqrt(OPTIMA["Bellman"] / len(t)))},
    )


def _measurements(path: Path) -> dict[str, dict[str, dict[float, tuple[float, str]]]]:
    """condition -> observable -> time -> measurement and its noise, of a file of PEtab."""
    found: dict[str, dict[str, dict[float, tuple[float, str]]]] = {}
    with path.open(encoding="utf-8") as lines:
        for row in csv.DictReader(lines, delimiter="\t"):
            own = found.setdefault(row["simulationConditionId"], {}).setdefault(row["observableId"], {})
            own[float(row["time"])] = float(row["measurement"]), row["noiseParameters"]
    return found


_BOEHM = {"Epo_deg": 0.026983, "k_exp_homo": 0.00617023, "k_imp_hetero": 0.0163679, "k_phos": 15766.5}
_BOEHM_HELD = {"k_exp_hetero": 1.00068e-5, "k_imp_homo": 97749.4}  # at their limits, and not identifiable
_RATIO, _C17, _NUCLEUS = 0.693, 0.107, 0.45 / 1.4


def _boehm(s: Any) -> dict[str, Any]:
    epo = 1.25e-7 * np.exp(-s.Epo_deg * s.t) * s.k_phos
    v0, v1, v2 = epo * s.A**2, epo * s.A * s.B, epo * s.B**2
    v3, v4, v5 = s.k_imp_homo * s.AA, s.k_imp_hetero * s.AB, s.k_imp_homo * s.BB
    v6, v7, v8 = s.k_exp_homo * s.nAA, s.k_exp_hetero * s.nAB, s.k_exp_homo * s.nBB
    return {
        "A": -2 * v0 - v1 + _NUCLEUS * (2 * v6 + v7),
        "B": -v1 - 2 * v2 + _NUCLEUS * (v7 + 2 * v8),
        "AB": v1 - v4,
        "AA": v0 - v3,
        "BB": v2 - v5,
        "nAA": v3 / _NUCLEUS - v6,
        "nAB": v4 / _NUCLEUS - v7,
        "nBB": v5 / _NUCLEUS - v8,
    }


def _boehm_seen(s: Any) -> dict[str, Any]:
    a = s.AB + s.A * _C17 + 2 * s.AA * _C17
    b = s.AB + (1 - _C17) * (s.B + 2 * s.BB)
    return {
        "pSTAT5A_rel": (100 * s.AB + 200 * s.AA * _C17) / a,
        "pSTAT5B_rel": (100 * s.AB + 200 * s.BB * (1 - _C17)) / b,
        "rSTAT5A_rel": (100 * s.AB + 100 * s.A * _C17 + 200 * s.AA * _C17) / (a + b - s.AB + s.AB),
    }


def boehm(folder: Path, off: float = 2.0) -> Problem:
    """Dimers of STAT5, stiff: four parameters from `off` times too much or too little, noise estimated."""
    ((_, seen),) = _measurements(folder / "petab_boehm_measurements.tsv").items()
    t = sorted({time for rows in seen.values() for time in rows})
    channels = {name: np.array([rows.get(time, (np.nan, ""))[0] for time in t]) for name, rows in seen.items()}
    states = ("A", "B", "AB", "AA", "BB", "nAA", "nAB", "nBB")
    begin = {"A": 207.6 * _RATIO, "B": 207.6 * (1 - _RATIO)}
    model = define_model(
        "Boehm",
        states=states,
        inputs=["t"],
        parameters=_BOEHM | _BOEHM_HELD,
        outputs=sorted(seen),
        dynamics=_boehm,
        output=_boehm_seen,
        initial=lambda _: dict.fromkeys(states, 0.0) | begin,
        state_scale=dict.fromkeys(states, 50.0),
    )
    start = {name: value * off ** (-1) ** i for i, (name, value) in enumerate(_BOEHM.items())}
    limits = [limit_parameter(name, lower=1e-5, upper=1e5) for name in _BOEHM]
    record = Record(name="boehm", t=np.array(t), channels=channels)
    return Problem(model, [record], free=list(_BOEHM), log=["*"], start=start, constraints=limits)


# which substance each condition of Bruno et al. begins with, besides nothing
_BRUNO = {1: "b10", 2: "bcar", 3: "bcar", 4: "bcry", 5: "ohb10", 6: "zea"}
_SUBSTANCES = ("bcar", "bcry", "b10", "bio", "ohb10", "ohbio", "zea")
_SEEN = {"obcar": "bcar", "obcry": "bcry", "ob10": "b10", "oohb10": "ohb10", "ozea": "zea"}
_RATES = ("kb1", "kb2", "kc1", "kc2", "kc4", "k5")
_SLOWER = (3, 6)  # conditions in which all rates are multiplied by one factor


def _bruno(s: Any) -> dict[str, Any]:
    speed = 1 + (s.factor - 1) * s.slower
    r1, r2, r3 = speed * s.kb1 * s.bcar, speed * s.kb2 * s.b10, speed * s.kc1 * s.bcry
    r4, r5, r6 = speed * s.kc2 * s.bcry, speed * s.kc4 * s.ohb10, speed * s.k5 * s.zea
    return {
        "bcar": -r1,
        "bcry": -r3 - r4,
        "b10": r1 - r2 + r3,
        "bio": r1 + r2 + r4,
        "ohb10": r4 - r5 + r6,
        "ohbio": r3 + r5 + r6,
        "zea": -r6,
    }


def bruno(folder: Path) -> Problem:
    """Cleavage of carotenoids: six conditions, each beginning with one substance of unknown amount; a noise per sample.
    What each condition has of its own is a parameter of the record."""
    records, held = [], {}
    for condition, seen in _measurements(folder / "petab_bruno_measurements.tsv").items():
        number = int(condition[-1])
        t = sorted({0.0, *(time for rows in seen.values() for time in rows)})
        channels = {}
        for name in _SEEN:
            pairs = [seen.get(name, {}).get(time, (np.nan, "nan")) for time in t]
            channels |= {name: np.array([y for y, _ in pairs]), f"s_{name}": np.array([float(s) for _, s in pairs])}
        records.append(Record(name=f"c{number}", t=np.array(t), channels=channels))
        held |= {f"has_{x}[c{number}]": float(x == _BRUNO[number]) for x in set(_BRUNO.values())}
        held[f"slower[c{number}]"] = float(number in _SLOWER)
    parts = sorted(set(_BRUNO.values()))
    model = define_model(
        "Bruno",
        states=_SUBSTANCES,
        inputs=(),
        parameters=dict.fromkeys(_RATES, 0.01)
        | {"factor": 1.0, "amount": 3.0, "slower": 0.0}
        | {f"has_{x}": 0.0 for x in parts},
        outputs=list(_SEEN),
        dynamics=_bruno,
        output=lambda s: {o: getattr(s, x) for o, x in _SEEN.items()},
        initial=lambda s: {x: s.amount * getattr(s, f"has_{x}") if x in parts else 0.0 for x in _SUBSTANCES},
    )
    noise = {name: f"s_{name}" for name in _SEEN}
    return Problem(model, records, free=[*_RATES, "factor"], per_record=["amount"], fixed=held, log=["*"], noise=noise)


def _squares(name: str, make: Callable[[Path], Problem], file: str = "") -> Published:
    return Published(name=name, kind="sum of squares", optimum=OPTIMA[name], make=make, file=file)


PUBLISHED = (
    _squares("alpha-pinene", pinene, "cops_pinene.csv"),
    _squares("marine population", marine, "cops_marine.csv"),
    _squares("methanol to hydrocarbons", methanol, "cops_methanol.csv"),
    _squares("gas oil cracking", gas_oil, "cops_gasoil.csv"),
    _squares("Bellman", bellman),
    Published(name="Boehm", kind="-ln L", optimum=138.2220, make=boehm, file="petab_boehm_measurements.tsv"),
    Published(name="Bruno", kind="-ln L", optimum=-46.68818, make=bruno, file="petab_bruno_measurements.tsv"),
)
