"""Structure that every real aircraft has and that a linear aircraft file leaves out: no cause, but in the way.

A parabolic drag polar, and the roll due to yaw rate and yaw due to roll rate that grow with lift (strip theory), are
put into the model before anything is named when the data demand them. So are small offsets of the instruments, which
every instrumentation has: a few of them together look like moving air. They stand under `minor`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.evaluation import Fit, scaled_inverse
from casid.diagnosis.evidence import weigh
from casid.diagnosis.hypothesis import Attached
from casid.diagnosis.screening import Screen, fingerprints
from casid.model.causes import aero_term, sensor_bias
from casid.model.path import aerodynamic_parameters

_EXPECTED = {
    "CD": ("alpha^2", "beta^2"),
    "CX": ("alpha^2", "beta^2"),
    "Cl": ("alpha*r",),
    "Cn": ("alpha*p",),
}
_DEMANDED = 50.0  # drop of the deviance that one of them must predict


def demanded_structure(base: Fit) -> list[Attached]:
    """Expected terms that the aircraft file lacks and the data of the fitted baseline ask for, ready to be fitted."""
    aircraft = base.flight.aircraft
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    present |= {(a.effect.target, a.effect.term or "") for a in base.attached}
    effects = [
        aero_term(coefficient, term)
        for coefficient in aircraft.coefficients
        for term in _EXPECTED.get(coefficient, ())
        if (coefficient, term) not in present
    ]
    judge, found = Screen(weigh(base, discrepancy=False)), []
    everywhere = np.ones((1, len(base.batch.names)))
    for one in fingerprints(judge.evidence, effects):
        statistic, size, _, _ = judge.score([one], everywhere)
        if statistic > _DEMANDED:
            found.append(Attached(effect=one.effect, values={"value": size}))
    return found


def demanded_offsets(base: Fit) -> list[Attached]:
    """Offsets of instruments that the data of the fitted baseline ask for and that are too small to matter, ready to be
    fitted; by forward selection, because some of them can hardly be told from each other. Those that matter are chosen
    as well, so that small ones do not imitate them, and left for the naming."""
    taken = {a.effect.key for a in base.attached}
    effects = [e for e in map(sensor_bias, base.model.outputs) if e.key not in taken]
    matters = [e.smallest_that_matters(base.flight.aircraft) for e in effects]
    information, match = _normal_equations(base, [base.model.outputs.index(e.target) for e in effects])
    squares, chosen, sizes = float(np.sum(base.white**2)), list[int](), np.zeros(0)
    while len(chosen) < len(effects):
        gained = float(sizes @ match[chosen])
        others = [i for i in range(len(effects)) if i not in chosen]
        gains = [float(_sizes(information, match, [*chosen, i]) @ match[[*chosen, i]]) for i in others]
        misfit = max(1.0, (squares - max(gains)) / base.readings)
        if max(gains) - gained < _DEMANDED * misfit:
            break
        chosen.append(others[int(np.argmax(gains))])
        sizes = _sizes(information, match, chosen)
    return [
        Attached(effect=effects[i], values={"value": float(size)}, slight=True)
        for i, size in zip(chosen, sizes, strict=True)
        if abs(size) < (matters[i] or 0.0)
    ]


def _normal_equations(base: Fit, channels: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Information of offsets of some `channels`, and their match with the residual, the fitted slots eliminated."""
    evidence, n = weigh(base, discrepancy=False), len(channels)
    Y = np.zeros((*base.read.shape, n))
    Y[..., channels, range(n)] = base.linear.seen[..., channels]
    white = base.filter.whiten(Y, np.zeros((*base.linear.defect.shape, n)))
    flat = [white[:, r].reshape(-1, n) for r in range(len(base.batch.names))]
    cross = np.sum([slots.T @ w for slots, w in zip(evidence.by_record, flat, strict=True)], axis=0)
    match = np.sum([base.white[:, r].reshape(-1) @ w for r, w in enumerate(flat)], axis=0)
    square = np.sum([w.T @ w for w in flat], axis=0)
    return square - cross.T @ evidence.covariance @ cross, match - cross.T @ evidence.newton


def _sizes(information: np.ndarray, match: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    return scaled_inverse(information[np.ix_(chosen, chosen)]) @ match[list(chosen)]
