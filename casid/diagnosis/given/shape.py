"""The shape of a latent input at a coefficient: a curve over the motion, kept only if it helps on held-out records.

The latent input is regressed on the motion of the same model: on a smooth table of one variable, or on such a table
times a second variable. The curve shows how the missing part depends on the motion. It does not name a cause,
and its straight line is shared with the derivatives of the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, decades, missing_at
from casid.diagnosis.flight.evaluation import FlightFit
from casid.model.aircraft import Aircraft
from casid.model.tables import table
from casid.model.terms import VARIABLES

_ALONE = "1"  # in place of a second variable


@dataclass(frozen=True, eq=False, kw_only=True)
class Points:
    """A latent input of one record at its nodes: values `y` (n,) with 1-sigma, and the variables there (n,)."""

    y: np.ndarray
    sigma: np.ndarray
    variables: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Curve of what is missing at a coefficient."""

    in_json: ClassVar[str] = "coefficient over times=second x y std held_out sentence"

    coefficient: str  # where it enters, as "Cm"
    over: str  # the variable of the curve, as "alpha"; rates are dimensionless
    times: str  # a second variable that the curve is multiplied by; empty: it is an increment of the coefficient itself
    # x, y, std: points of the curve, (points,), and the 1-sigma of y; an increment of the coefficient is zero on
    # average
    x: np.ndarray
    y: np.ndarray
    std: np.ndarray
    # root mean square of what is missing on records that no fit has seen, before over after the curve is taken off
    held_out: float

    @property
    def sentence(self) -> str:
        """The curve in words."""
        what = f"{self.times} times a function of {self.over}" if self.times else f"a function of {self.over}"
        return (
            f"What is missing in {self.coefficient} has the shape of {what}; on records that no fit has seen, the "
            f"curve leaves {100.0 / self.held_out:.0f} % of it. This is a description, and no cause."
        )

    @property
    def second(self) -> str | None:
        """The variable of `times`; None where there is none."""
        return self.times or None


def with_shapes(aircraft: Aircraft, shapes: Sequence[Shape]) -> Aircraft:
    """The aircraft with each shape as a further table, which keeps its ends beyond what was flown."""
    tables = [
        table(
            one.coefficient,
            one.over,
            one.x,
            one.y,
            name=f"unexplained_{one.coefficient}_{number}",
            times=one.times or "0",
        )
        for number, one in enumerate(shapes, 1)
    ]
    return replace(aircraft, tables=(*aircraft.tables, *tables))


def shapes_of(fit: FlightFit, held: FlightFit, unexplained: Sequence[MissingInput]) -> tuple[Shape, ...]:
    """The shapes of what is unexplained at coefficients of a fit; `held` is the same model on held-out records."""
    found = []
    for missing in unexplained:
        if missing.place.kind != "coefficient" or not missing.concerns(fit.batch.names):
            continue
        (unseen,) = missing_at(weigh(held), [missing.station])
        shape = shape_of(missing.place.name, _points(fit, missing), _points(held, unseen), fit.criteria)
        found += [shape] if shape is not None else []
    return tuple(found)


def shape_of(coefficient: str, fitted: Sequence[Points], held: Sequence[Points], criteria: Criteria) -> Shape | None:
    """The curve by which the fitted records predict each other best, if held-out ones support it; else None.

    A curve is kept that makes the errors on records left out clearly smaller.
    """
    gains = criteria.parts.slightly
    parts = _stretches(fitted)
    penalties = decades(criteria.numerics.missing_input)
    scored = [(*_left_out(parts, basis, penalties), basis) for basis in _bases(fitted, criteria)]
    if not (scored and held):
        return None
    single = max((row[0] for row in scored if row[2].times == _ALONE), default=1.0)  # the simpler curve comes first
    able = [row for row in scored if row[2].times == _ALONE or row[0] > gains * single]
    ratio, penalty, basis = max(able, key=lambda row: row[0])
    if ratio < gains:
        return None
    coefficients, covariance = basis.fitted([basis.equations(one) for one in fitted], penalty)
    before, after = np.sum([_squares(basis.equations(one), coefficients) for one in held], axis=0)
    if before < gains**2 * after:
        return None
    x = np.array(basis.nodes)
    design = basis.design(x)
    if basis.times == _ALONE:  # a constant is not determined: every record has an offset of its own
        design -= np.mean(np.concatenate([basis.design(one.variables[basis.over]) for one in fitted]), axis=0)
    return Shape(
        coefficient=coefficient,
        over=basis.over,
        times="" if basis.times == _ALONE else basis.times,
        x=x,
        y=design @ coefficients,
        std=np.sqrt(np.einsum("ij,jk,ik->i", design, covariance, design)),
        held_out=float(np.sqrt(before / after)),
    )


Equations = tuple[np.ndarray, np.ndarray]  # whitened rows (n, coefficients) and right-hand side (n,)


@dataclass(frozen=True, kw_only=True)
class _Basis:
    """A table of one variable at its nodes, times another variable."""

    over: str
    times: str
    nodes: tuple[float, ...]

    def design(self, x: np.ndarray) -> np.ndarray:
        """(n, nodes) of the table; constant beyond its range."""
        return np.stack([np.interp(x, self.nodes, one) for one in np.eye(len(self.nodes))], axis=1)

    def equations(self, one: Points) -> Equations:
        """Those of a record; it has a mean of its own, which is taken off."""
        factor = np.ones(len(one.y)) if self.times == _ALONE else one.variables[self.times]
        rows = factor[:, None] * self.design(one.variables[self.over])
        weight = one.sigma**-2.0 / np.sum(one.sigma**-2.0)
        rows = rows - weight @ rows
        y = one.y - weight @ one.y
        return rows / one.sigma[:, None], y / one.sigma

    def fitted(self, equations: Sequence[Equations], penalty: float) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients and their covariance, by least squares with a penalty on second differences."""
        rows, y = (np.concatenate(part) for part in zip(*equations, strict=True))
        gram = rows.T @ rows
        size = rows.shape[1]
        bend = np.diff(np.eye(size), 2, axis=0)
        scale = float(np.trace(gram)) / size
        inverse = np.linalg.pinv(gram + scale * penalty * bend.T @ bend, hermitian=True)
        coefficients = inverse @ rows.T @ y
        freedom = max(len(y) - float(np.trace(inverse @ gram)), 1.0)
        left = y - rows @ coefficients
        return coefficients, max(float(left @ left) / freedom, 1.0) * inverse


def _bases(fitted: Sequence[Points], criteria: Criteria) -> Iterator[_Basis]:
    """Over every variable that moves, alone and times every other one."""
    there = set.intersection(*(set(one.variables) for one in fitted)) if fitted else set()
    pooled = {name: np.concatenate([one.variables[name] for one in fitted]) for name in VARIABLES if name in there}
    moving = [name for name, x in pooled.items() if np.ptp(x) > criteria.numerics.rounding * max(1.0, np.abs(x).max())]
    count = 1 + round(0.5 * criteria.numerics.samples_per_cycle)  # from one end to the other in half a cycle
    for over in moving:
        nodes = np.linspace(pooled[over].min(), pooled[over].max(), count)
        for times in (_ALONE, *(name for name in moving if name != over)):
            yield _Basis(over=over, times=times, nodes=tuple(nodes.tolist()))


def _stretches(fitted: Sequence[Points]) -> list[Points]:
    """Records to be left out in turn; of a single one its halves."""
    if len(fitted) > 1:
        return list(fitted)
    return [_part(one, at) for one in fitted for at in np.array_split(np.arange(len(one.y)), 2)]


def _part(one: Points, at: np.ndarray) -> Points:
    return Points(
        y=one.y[at], sigma=one.sigma[at], variables={name: series[at] for name, series in one.variables.items()}
    )


def _left_out(parts: Sequence[Points], basis: _Basis, penalties: np.ndarray) -> tuple[float, float]:
    """Ratio of errors without and with the curve, each record by a curve of the others, and the penalty at which it is
    largest."""
    equations = [basis.equations(one) for one in parts]
    found = []
    for penalty in penalties.tolist():
        squares = np.zeros(2)
        for i, one in enumerate(equations):
            coefficients, _ = basis.fitted([*equations[:i], *equations[i + 1 :]], penalty)
            squares += _squares(one, coefficients)
        found.append((float(np.sqrt(squares[0] / squares[1])), penalty))
    return max(found)


def _squares(equations: Equations, coefficients: np.ndarray) -> tuple[float, float]:
    """Weighted squares of a history before and after the curve is taken off."""
    rows, y = equations
    left = y - rows @ coefficients
    return float(y @ y), max(float(left @ left), 1e-300)


def _points(fit: FlightFit, missing: MissingInput) -> list[Points]:
    """The history in every record of a fit, with the variables averaged about each of its nodes. A record shorter than
    the distance of the nodes has one node and no history."""
    found = []
    for r, record in enumerate(fit.flight.records):
        t, mean, sigma = missing.history.get(record.name, (np.zeros(0),) * 3)
        if len(t) < 2:
            continue
        weight = np.maximum(0.0, 1.0 - np.abs(record.t[:, None] - t) / (t[1] - t[0]))
        weight /= np.maximum(weight.sum(axis=0), 1e-300)
        variables = {
            name: weight.T @ np.broadcast_to(series, fit.batch.live.shape)[: len(record), r]
            for name, series in fit.regressors.items()
            if name in VARIABLES
        }
        found.append(Points(y=mean, sigma=np.maximum(sigma, 1e-12), variables=variables))
    return found
