"""The statistical reference data sets of NIST for nonlinear regression: 27 models with certified results.

Source: NIST/ITL StRD, https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml, public domain. The data stay outside the
project; a file's head has two starts, the certified parameters and their standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from casid.estimation.problem import Problem
from casid.model.system import define_regression
from casid.records.record import Record

Formula = Callable[[Any, Any, Any], Any]


def _gauss(m: Any, x: Any, b: Any) -> Any:
    first, second = ((x[0] - b[i]) ** 2 / b[i + 1] ** 2 for i in (3, 6))
    return b[0] * m.exp(-b[1] * x[0]) + b[2] * m.exp(-first) + b[5] * m.exp(-second)


def _lanczos(m: Any, x: Any, b: Any) -> Any:
    return sum(b[i] * m.exp(-b[i + 1] * x[0]) for i in (0, 2, 4))


def _rational(m: Any, x: Any, b: Any, above: int) -> Any:
    top = sum(b[i] * x[0] ** i for i in range(above))
    return top / (1 + sum(b[above + i] * x[0] ** (i + 1) for i in range(len(b) - above)))


def _enso(m: Any, x: Any, b: Any) -> Any:
    found = b[0]
    for period, first, second in ((12.0, b[1], b[2]), (b[3], b[4], b[5]), (b[6], b[7], b[8])):
        angle = 2 * np.pi * x[0] / period
        found = found + first * m.cos(angle) + second * m.sin(angle)
    return found


def _chwirut(m: Any, x: Any, b: Any) -> Any:
    return m.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


# (functions, predictors, parameters) -> response
FORMULAS: dict[str, Formula] = {
    "Bennett5": lambda m, x, b: b[0] * (b[1] + x[0]) ** (-1 / b[2]),
    "BoxBOD": lambda m, x, b: b[0] * (1 - m.exp(-b[1] * x[0])),
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda m, x, b: b[0] * x[0] ** b[1],
    "ENSO": _enso,
    "Eckerle4": lambda m, x, b: b[0] / b[1] * m.exp(-0.5 * ((x[0] - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": lambda m, x, b: _rational(m, x, b, 4),
    "Kirby2": lambda m, x, b: _rational(m, x, b, 3),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda m, x, b: b[0] * (x[0] ** 2 + x[0] * b[1]) / (x[0] ** 2 + x[0] * b[2] + b[3]),
    "MGH10": lambda m, x, b: b[0] * m.exp(b[1] / (x[0] + b[2])),
    "MGH17": lambda m, x, b: b[0] + b[1] * m.exp(-x[0] * b[3]) + b[2] * m.exp(-x[0] * b[4]),
    "Misra1a": lambda m, x, b: b[0] * (1 - m.exp(-b[1] * x[0])),
    "Misra1b": lambda m, x, b: b[0] * (1 - (1 + b[1] * x[0] / 2) ** (-2)),
    "Misra1c": lambda m, x, b: b[0] * (1 - (1 + 2 * b[1] * x[0]) ** (-0.5)),
    "Misra1d": lambda m, x, b: b[0] * b[1] * x[0] / (1 + b[1] * x[0]),
    "Nelson": lambda m, x, b: b[0] - b[1] * x[0] * m.exp(-b[2] * x[1]),  # of the logarithm of the response
    "Rat42": lambda m, x, b: b[0] / (1 + m.exp(b[1] - b[2] * x[0])),
    "Rat43": lambda m, x, b: b[0] / (1 + m.exp(b[1] - b[2] * x[0])) ** (1 / b[3]),
    "Roszman1": lambda m, x, b: b[0] - b[1] * x[0] - m.atan(b[2] / (x[0] - b[3])) / np.pi,
    "Thurber": lambda m, x, b: _rational(m, x, b, 4),
}


# terms that may change places, and the model stays the same: groups of parameters
EXCHANGEABLE: dict[str, tuple[tuple[int, ...], ...]] = {
    "MGH17": ((1, 3), (2, 4)),
    "Gauss1": ((2, 3, 4), (5, 6, 7)),
    "Gauss2": ((2, 3, 4), (5, 6, 7)),
    "Gauss3": ((2, 3, 4), (5, 6, 7)),
    "Lanczos1": ((0, 1), (2, 3), (4, 5)),
    "Lanczos2": ((0, 1), (2, 3), (4, 5)),
    "Lanczos3": ((0, 1), (2, 3), (4, 5)),
    "ENSO": ((3, 4, 5), (6, 7, 8)),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Reference:
    """A data set: predictors x (k, N), response y (N,), two starts, and the certified values with their 1-sigma."""

    name: str
    x: np.ndarray
    y: np.ndarray
    starts: tuple[np.ndarray, np.ndarray]
    certified: np.ndarray
    std: np.ndarray

    def response(self, parameters: np.ndarray, functions: ModuleType | Any) -> Any:
        """What the model gives at the predictors, with the functions of `functions`."""
        return FORMULAS[self.name](functions, self.x, parameters)

    def problem(self, start: int) -> Problem:
        """The regression as casid takes it, from start 0 or 1."""
        names = [f"b{i + 1}" for i in range(len(self.certified))]
        predictors = [f"x{i + 1}" for i in range(len(self.x))]

        def output(s: Any) -> Mapping[str, Any]:
            x, b = ([getattr(s, name) for name in group] for group in (predictors, names))
            return {"y": FORMULAS[self.name](ca, x, b)}

        nominal = dict(zip(names, self.starts[start].tolist(), strict=True))
        model = define_regression(self.name, inputs=predictors, parameters=nominal, outputs=["y"], output=output)
        channels = dict(zip(predictors, self.x, strict=True)) | {"y": self.y}
        record = Record(name=self.name, t=np.arange(len(self.y), dtype=float), channels=channels)
        return Problem(model, [record], free=["*"])

    def in_order(self, found: np.ndarray) -> np.ndarray:
        """(p,) indices that put what was found in the order that is certified: terms may have changed places."""
        groups = EXCHANGEABLE.get(self.name, ())
        orders = [_exchanged(len(found), groups, order) for order in permutations(groups)]
        return max(orders, key=lambda order: self._digits(found[order]))

    def digits(self, found: np.ndarray) -> float:
        """Certified digits of the worst parameter, at most 11: as many as are certified. Of terms that may change
        places the order does not count."""
        return self._digits(found[self.in_order(found)])

    def _digits(self, found: np.ndarray) -> float:
        error = np.abs(found - self.certified) / np.abs(self.certified)
        worst = float(np.nan_to_num(error, nan=1.0, posinf=1.0).max())
        return max(-math.log10(max(worst, 1e-11)), 0.0)


def _exchanged(count: int, groups: Sequence[Sequence[int]], order: Sequence[Sequence[int]]) -> np.ndarray:
    """(count,) indices, with those of each group in the place of another."""
    index = np.arange(count)
    for to, of in zip(groups, order, strict=True):
        index[list(to)] = list(of)
    return index


def read_reference(path: Path) -> Reference:
    """A data set from its file."""
    lines = path.read_text(encoding="ascii").splitlines()
    rows = [line.split("=")[1].split() for line in lines[:60] if line.strip().startswith("b") and "=" in line]
    table = np.array([[float(v) for v in row] for row in rows if len(row) == 4])
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()])
    y = np.log(data[:, 0]) if path.stem == "Nelson" else data[:, 0]
    return Reference(
        name=path.stem,
        x=data[:, 1:].T,
        y=y,
        starts=(table[:, 0], table[:, 1]),
        certified=table[:, 2],
        std=table[:, 3],
    )
