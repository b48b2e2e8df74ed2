"""What the surfaces do to the aircraft, against the derivatives of the file: sign, unit and swap of their records.

The measured coefficients of force and moment are regressed on the motion, with the file's derivatives as prior: an
explanation that needs derivatives far from the file pays for it, be it the records' fault or the file's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.data.alternatives import Alternative
from casid.diagnosis.data.criteria import CRITERIA
from casid.diagnosis.data.reading import Read, Reading
from casid.model.aircraft import Aircraft
from casid.model.path import aerodynamic_parameters, speed_of_sound
from casid.model.terms import parse_term
from casid.signals import SURFACES

_LEAST = 0.1  # of a coefficient's variation: what a linear model of constant derivatives leaves at least
_NEEDED: Mapping[str, tuple[str, ...]] = {
    "Cl": ("p",),
    "Cm": ("q",),
    "Cn": ("r",),
    "CY": ("ay",),
    "CL": ("az", "ax", "alpha"),
    "CZ": ("az",),
}
_UNSTEADY = ("alphadot", "betadot")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Column:
    """One coefficient of all records: measured values and, by parameter, its regressors, without their means."""

    coefficient: str
    names: tuple[str, ...]
    terms: tuple[str, ...]
    prior: np.ndarray
    y: np.ndarray
    record: np.ndarray  # index of the record of every sample
    X: np.ndarray


class Response:
    """The response that an aircraft file predicts, and what records say of it."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft

    def gains(
        self, records: Sequence[Read], able: Sequence[Alternative]
    ) -> list[tuple[Alternative, list[float]]]:
        """Log likelihood ratio in every record of the alternatives for surfaces, beside those of the file's signs.

        Records share the derivatives; the gain of an alternative in one record is what it gains there alone, or
        with all others, whichever tells of it. An error of sign in the file is an alternative that no reading makes.
        """
        reads = [c for c in records if c.has("V", "rho") and any(c.has(s) for s in SURFACES)]
        if not reads:
            return []
        everywhere = range(len(records))
        plain = self._columns(records, {})
        floor = {c: self._noise([self._columns(records, {})[c], *self._each(records, able, c)]) for c in plain}
        base = self._evidence(plain, floor)
        found = []
        for alternative in able:
            together = self._evidence(self._columns(records, dict.fromkeys(everywhere, alternative.reading)), floor)
            alone = [
                self._evidence(self._columns(records, {j: alternative.reading}), floor) - base for j in everywhere
            ]
            total = together - base
            rest = max(alone)
            if len(records) > 1 and rest > total:
                found.append((alternative, alone))
            else:
                found.append((alternative, [total / len(records)] * len(records)))
        return [*found, *self._file_signs(plain, floor, base, len(records))]

    def _each(self, records: Sequence[Read], able: Sequence[Alternative], coefficient: str) -> list[_Column]:
        found = []
        for alternative in able:
            for which in (dict.fromkeys(range(len(records)), alternative.reading), {0: alternative.reading}):
                columns = self._columns(records, which)
                if coefficient in columns:
                    found.append(columns[coefficient])
        return found

    def _file_signs(
        self, plain: Mapping[str, _Column], floor: Mapping[str, float], base: float, count: int
    ) -> list[tuple[Alternative, list[float]]]:
        found = []
        for coefficient, column in plain.items():
            for i, (name, term) in enumerate(zip(column.names, column.terms, strict=True)):
                if term not in SURFACES or column.prior[i] == 0.0:
                    continue
                prior = column.prior.copy()
                prior[i] = -prior[i]
                gain = _log_evidence(column, prior, floor[coefficient]) - _log_evidence(
                    column, column.prior, floor[coefficient]
                )
                alternative = Alternative(kind="file_sign", target=name, reading=Reading())
                found.append((alternative, [gain / count] * count))
        return found

    def _columns(self, records: Sequence[Read], readings: Mapping[int, Reading]) -> dict[str, _Column]:
        """Coefficient -> column, of all records that can tell of it, some of them with other surfaces."""
        by_coefficient: dict[str, list[tuple[int, np.ndarray, np.ndarray]]] = {}
        rows = _rows(self._aircraft)
        for j, record in enumerate(records):
            if not record.has("V", "rho"):
                continue
            regressors = _regressors(record, self._aircraft, readings.get(j))
            measured = _measured(record, self._aircraft)
            every = max(1, round(len(record.value("V")) / record.independent))
            for coefficient, (_, terms, _) in rows.items():
                if not record.has(*_NEEDED[coefficient]):
                    continue
                X = np.stack([parse_term(t).evaluate(regressors) * np.ones(len(measured[coefficient])) for t in terms], 1)
                at = np.flatnonzero(record.known("V", *_NEEDED[coefficient], "alpha", "beta"))[::every]
                y, X = measured[coefficient][at], X[at]
                by_coefficient.setdefault(coefficient, []).append((j, y - y.mean(), X - X.mean(axis=0)))
        found = {}
        for coefficient, parts in by_coefficient.items():
            names, terms, prior = rows[coefficient]
            found[coefficient] = _Column(
                coefficient=coefficient,
                names=names,
                terms=terms,
                prior=prior,
                y=np.concatenate([y for _, y, _ in parts]),
                record=np.concatenate([np.full(len(y), j) for j, y, _ in parts]),
                X=np.concatenate([X for _, _, X in parts]),
            )
        return {c: column for c, column in found.items() if np.std(column.y) > 0.0 and np.isfinite(column.X).all()}

    def _noise(self, columns: Sequence[_Column]) -> float:
        """1-sigma of what is left with free derivatives, by the best of the alternatives."""
        left = []
        for column in columns:
            free = np.linalg.lstsq(column.X, column.y, rcond=1e-8)[0]
            left.append(float(np.std(column.y - column.X @ free)))
        return max(min(left), _LEAST * float(np.std(columns[0].y)))

    def _evidence(self, columns: Mapping[str, _Column], noise: Mapping[str, float]) -> float:
        return sum(_log_evidence(column, column.prior, noise[c]) for c, column in columns.items() if c in noise)


def _log_evidence(column: _Column, prior: np.ndarray, noise: float) -> float:
    """Log marginal likelihood of a coefficient, derivatives about `prior`, up to what all alternatives share."""
    spread = CRITERIA.derivative * np.abs(column.prior)
    off = (column.y - column.X @ prior) / noise
    A = column.X * spread / noise
    M = np.eye(A.shape[1]) + A.T @ A
    b = A.T @ off
    return -0.5 * float(off @ off - b @ np.linalg.solve(M, b)) - 0.5 * float(np.linalg.slogdet(M)[1])


def _rows(aircraft: Aircraft) -> dict[str, tuple[tuple[str, ...], tuple[str, ...], np.ndarray]]:
    """Coefficient -> names, terms and values of what the file has, without the constant."""
    values = {**aircraft.derivatives}
    table: dict[str, list[tuple[str, str, float]]] = {}
    for coefficient, name, term in aerodynamic_parameters(aircraft):
        value = values.get(name, aircraft.terms.get(coefficient, {}).get(term, 0.0))
        if coefficient in _NEEDED and term != "0" and not any(u in term for u in _UNSTEADY) and value != 0.0:
            table.setdefault(coefficient, []).append((name, term, value))
    return {
        c: (tuple(n for n, _, _ in rows), tuple(t for _, t, _ in rows), np.array([v for _, _, v in rows]))
        for c, rows in table.items()
    }


def _regressors(c: Read, aircraft: Aircraft, reading: Reading | None) -> dict[str, np.ndarray]:
    V = np.maximum(c.value("V"), 1.0)
    reading = reading or Reading()
    surfaces = {s: reading.factor.get(s, 1.0) * c.value(reading.source.get(s, s)) for s in SURFACES}
    found = {
        "alpha": c.value("alpha"),
        "beta": c.value("beta"),
        "p": c.value("p") * aircraft.rate_length_lateral / V,
        "q": c.value("q") * aircraft.rate_length_pitch / V,
        "r": c.value("r") * aircraft.rate_length_lateral / V,
        **surfaces,
        "mach": V / np.asarray(speed_of_sound(np.maximum(c.value("rho"), 1e-3))),
        "Tc": c.value("thrust") / (0.5 * np.maximum(c.value("rho"), 1e-3) * V**2 * aircraft.area),
    }
    trimmed = aircraft.trim.get("V", float(V.mean()))
    return found | {"V": (V - trimmed) / trimmed}


def _measured(c: Read, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """(N,) coefficients that the motion tells."""
    p, q, r = (c.value(name) for name in "pqr")
    pdot, qdot, rdot = (c.rate(name) if c.has(name) else np.zeros(len(p)) for name in "pqr")
    inertia = aircraft.inertia
    Ixx, Iyy, Izz, Ixz = inertia.Ixx, inertia.Iyy, inertia.Izz, inertia.Ixz
    qS = 0.5 * np.maximum(c.value("rho"), 1e-3) * np.maximum(c.value("V"), 1.0) ** 2 * aircraft.area
    roll = Ixx * pdot - Ixz * rdot + (Izz - Iyy) * q * r - Ixz * p * q
    pitch = Iyy * qdot + (Ixx - Izz) * p * r + Ixz * (p**2 - r**2)
    yaw = Izz * rdot - Ixz * pdot + (Iyy - Ixx) * p * q + Ixz * q * r
    alpha, m = c.value("alpha"), aircraft.mass
    return {
        "Cl": roll / (qS * aircraft.moment_length_lateral),
        "Cm": (pitch - aircraft.thrust_line_z * c.value("thrust")) / (qS * aircraft.moment_length_pitch),
        "Cn": yaw / (qS * aircraft.moment_length_lateral),
        "CY": m * c.value("ay") / qS,
        "CL": m * (np.sin(alpha) * c.value("ax") - np.cos(alpha) * c.value("az")) / qS,
        "CZ": m * c.value("az") / qS,
    }
