"""The flight into which an effect is to be hidden: what decides how large an effect is noticeable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from casid.model.aircraft import Aircraft
from casid.model.path import speed_of_sound
from casid.model.terms import parse_term
from casid.records.record import Record
from problems.jsbsim.apriori import STRUCTURE, Regression, coefficients, regress, regressors_of

_SEEN = 0.03  # of a coefficient's variation: a product term that leaves more unexplained belongs into the aircraft file
_MOST_PRODUCTS = 3
_LATERAL_VARIABLES = ("beta", "p", "r", "delta_a", "delta_r")
_LONGITUDINAL_VARIABLES = ("alpha", "q", "delta_e")
LATERAL = ("CY", "Cl", "Cn")


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Four healthy flights without noise, and what is known of the aircraft.

    aircraft       exact mass properties and lengths
    records        noise-free, all channels, of the same inputs as the blind flights
    structure      coefficient -> terms that the aircraft file will have
    sizes          input size per surface [rad] and of the throttle
    configuration  coefficient -> step of the aircraft's own change of configuration; empty: has none
    free_steps     the steps of a change of configuration may be chosen at will
    """

    aircraft: Aircraft
    records: tuple[Record, ...]
    structure: Mapping[str, Sequence[str]]
    sizes: Mapping[str, float]
    configuration: Mapping[str, float]
    free_steps: bool

    @property
    def V(self) -> float:
        return float(self.aircraft.trim["V"])

    @property
    def span(self) -> float:
        return 2.0 * self.aircraft.rate_length_lateral

    @property
    def chord(self) -> float:
        return 2.0 * self.aircraft.rate_length_pitch

    def record(self, name: str) -> Record:
        return next(record for record in self.records if record.name == name)

    @cached_property
    def variables(self) -> dict[str, np.ndarray]:
        """(N,) of all records one after another: the aircraft file's regressors, Mach, alphadot and betadot."""
        parts = [regressors_of(self.aircraft, record) | self._further(record) for record in self.records]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    @cached_property
    def coefficients(self) -> dict[str, np.ndarray]:
        """(N,) of all records one after another."""
        parts = [coefficients(self.aircraft, record) for record in self.records]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _further(self, record: Record) -> dict[str, np.ndarray]:
        V = record["V"]
        rates = {
            f"{angle}dot": np.gradient(record[angle], record.t) * length / V
            for angle, length in (
                ("alpha", self.aircraft.rate_length_pitch),
                ("beta", self.aircraft.rate_length_lateral),
            )
        }
        return rates | {"mach": V / np.asarray(speed_of_sound(record["rho"]), dtype=float).ravel()}

    def column(self, term: str) -> np.ndarray:
        """(N,) a term along all records."""
        if term in ("alphadot", "betadot"):
            return self.variables[term]
        return parse_term(term).evaluate(self.variables) * np.ones_like(self.variables["alpha"])

    def size_of_share(self, coefficient: str, series: np.ndarray, share: float) -> tuple[float, float]:
        """(value, share reached): the factor on a series (N,) with which it adds `share` of the coefficient's
        variation that the file's terms cannot imitate, without adding more than 0.8 of that variation itself."""
        whole, left = float(np.std(self.coefficients[coefficient])), self._unlike(coefficient, series)
        value = min(share * whole / max(float(np.std(left)), 1e-12), 0.8 * whole / max(float(np.std(series)), 1e-12))
        return value, value * float(np.std(left)) / whole

    def at_work(self, coefficient: str, series: np.ndarray) -> float:
        """Part of the flight during which what the file's terms leave of a series (N,) acts: 1 when it is as large at
        all times, 0 for a spike."""
        power = self._unlike(coefficient, series) ** 2
        return float(power.mean() ** 2 / max(float(np.mean(power**2)), 1e-300))

    def _unlike(self, coefficient: str, series: np.ndarray) -> np.ndarray:
        A = np.stack([self.column(term) for term in self.structure[coefficient]], axis=1)
        return series - A @ np.linalg.lstsq(A, series, rcond=None)[0]


def even_products(coefficient: str, degrees: Sequence[int] = (2,)) -> list[str]:
    """Monomials that the symmetry of an aircraft allows in a coefficient: an odd number of lateral variables in
    CY, Cl, Cn, an even one in the others."""
    names = []
    for degree in degrees:
        for variables in combinations_with_replacement((*_LONGITUDINAL_VARIABLES, *_LATERAL_VARIABLES), degree):
            odd = sum(v in _LATERAL_VARIABLES for v in variables) % 2
            if odd == (coefficient in LATERAL):
                names.append(parse_term("*".join(variables)).name)
    return names


def _cubes(coefficient: str) -> list[str]:
    return [f"{v}^3" for v in (_LATERAL_VARIABLES if coefficient in LATERAL else _LONGITUDINAL_VARIABLES)]


def demanded(aircraft: Aircraft, records: Sequence[Record]) -> tuple[dict[str, tuple[str, ...]], Regression]:
    """The terms that an engineer would have in the aircraft file: STRUCTURE and, one after another, the products and
    cubes without which more than `_SEEN` of a coefficient's variation stays unexplained, and which explain it.

    Returned with the regression, whose R2 say what is left.
    """
    structure = {c: tuple(terms) for c, terms in STRUCTURE.items()}
    found = regress(aircraft, records, structure)
    for coefficient in structure:
        for _ in range(_MOST_PRODUCTS):
            left = 1.0 - found.R2[coefficient]
            if left < _SEEN**2:
                break
            trials = {
                term: regress(aircraft, records, {coefficient: (*structure[coefficient], term)}).R2[coefficient]
                for term in (*even_products(coefficient), *_cubes(coefficient))
                if term not in structure[coefficient]
            }
            best = max(trials, key=lambda term: trials[term])
            if trials[best] - found.R2[coefficient] < (0.7 * _SEEN) ** 2:
                break
            structure[coefficient] = (*structure[coefficient], best)
            found = regress(aircraft, records, structure)
    return {c: tuple(found.values[c]) for c in structure}, found
