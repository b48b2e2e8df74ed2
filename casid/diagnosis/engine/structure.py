"""Structure that every real aircraft has and that a linear aircraft file leaves out: no cause, but in the way.

A parabolic drag polar is put into the model before anything is named when the data demand it. So are the roll due to
yaw rate and the yaw due to roll rate that grow with lift (strip theory). Small offsets of the instruments are, too, and
a few milliseconds between attitudes and rates, which every instrumentation has. A few of them together look like moving
air, and what milliseconds do to a bank angle can be made of an offset of the accelerometers. They stand under `minor`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.projection import Projection
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.hypothesis import Attached, readings
from casid.model.causes import aero_term, sensor_delay
from casid.model.effect import Effect
from casid.model.path import aerodynamic_parameters

_EXPECTED = {
    "CD": ("alpha^2", "beta^2"),
    "CX": ("alpha^2", "beta^2"),
    "Cl": ("alpha*r",),
    "Cn": ("alpha*p",),
}
_UNIT, _ATTITUDES = ("inertial",), ("phi", "theta", "psi")
SKEWED = (*_UNIT, *_ATTITUDES)  # what may come milliseconds late without being at fault


def is_usual(effect: Effect) -> bool:
    """Whether an effect is structure that every aircraft has."""
    return effect.regressor is not None and effect.regressor in _EXPECTED.get(effect.target, ())


def is_induced_drag(effect: Effect, value: float, fit: FlightFit) -> bool:
    """Whether a drag of alpha^2 is no more than lift induces: CL_alpha^2 / (pi A e), aspect ratio A, Oswald's factor e
    at the lowest that wings have."""
    if (effect.target, effect.regressor) != ("CD", "alpha^2"):
        return False
    aircraft = fit.flight.aircraft
    lift = fit.derivatives.get("CL_alpha", aircraft.derivatives.get("CL_alpha", 0.0))
    aspect = aircraft.area / aircraft.moment_length_pitch**2
    return 0.0 <= value <= lift**2 / (np.pi * aspect * fit.criteria.structure.oswald)


def demanded_structure(base: FlightFit) -> list[Attached]:
    """Expected terms that the aircraft file lacks and that improve the fitted baseline significantly, ready to be
    fitted."""
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
        if statistic > base.criteria.structure.demanded:
            found.append(Attached(effect=one.effect, values={"value": size}))
    return found


def demanded_offsets(base: FlightFit) -> list[Attached]:
    """Offsets of instruments that improve the fitted baseline significantly and are too small to matter, ready to be
    fitted."""
    channels = base.model.outputs
    enter = np.broadcast_to(np.eye(len(channels)), (*base.read.shape, len(channels)))
    return _demanded(base, base.flight.offsets, enter)[0]


def demanded_skews(reconstructed: FlightFit) -> tuple[list[Attached], float]:
    """The same of milliseconds by which kinematics find the inertial unit late behind all else, or attitudes behind the
    rates of which they are the integrals, whichever explains more; and the drop of the deviance. Without attitudes
    nothing tells them from vanes that stand elsewhere: then there are none."""
    fit, outputs = reconstructed, reconstructed.model.outputs
    attitudes = [c for c in _ATTITUDES if c in outputs]
    step = fit.criteria.numerics.naming.skew_step * float(np.median(fit.batch.dt))
    found = [(list[Attached](), 0.0)]
    for group in (_UNIT, attitudes) if attitudes else ():
        late = [Attached(effect=sensor_delay(target), values={"value": step}) for target in group]
        read = [readings([a], fit.batch.names, fit.batch.t, fit.linear.output, outputs, fit.known) for a in late]
        enter = (np.stack(read, axis=3) - fit.linear.output[..., None]) / step
        found.append(_demanded(fit, [a.effect for a in late], enter))
    return max(found, key=lambda one: one[1])


def _demanded(base: FlightFit, effects: Sequence[Effect], enter: np.ndarray) -> tuple[list[Attached], float]:
    """Those of `effects`, which add `enter` (N, R, ny, effects) to the readings, that gain significantly and are too
    small to matter; and the gain of all that are chosen.

    By forward selection, because the responses to some are nearly collinear. Effects that matter are chosen as well, so
    that small ones do not imitate them, and left for the naming.
    """
    taken = {a.effect.key for a in base.attached}
    offered = [i for i, e in enumerate(effects) if e.key not in taken]
    if not offered:
        return [], 0.0
    left = _projected(base, enter[..., offered])
    information, match = left.gram, left.match
    squares, chosen, sizes, gained = float(np.sum(base.white**2)), list[int](), np.zeros(0), 0.0
    while len(chosen) < len(offered):
        others = [i for i in range(len(offered)) if i not in chosen]
        gains = [float(_sizes(information, match, [*chosen, i]) @ match[[*chosen, i]]) for i in others]
        misfit = max(1.0, (squares - max(gains)) / base.readings)
        if max(gains) - gained < base.criteria.structure.demanded * misfit:
            break
        chosen.append(others[int(np.argmax(gains))])
        sizes, gained = _sizes(information, match, chosen), max(gains)
    found = [
        Attached(effect=effects[offered[i]], values={"value": float(size)}, nuisance=True)
        for i, size in zip(chosen, sizes, strict=True)
    ]
    aircraft = base.flight.aircraft
    small = [one for one in found if abs(one.values["value"]) < (one.effect.smallest_that_matters(aircraft) or 0.0)]
    return small, gained


def _projected(base: FlightFit, enter: np.ndarray) -> Projection:
    """Of what `enter`s the readings, the fitted slots eliminated."""
    evidence, n = weigh(base, discrepancy=False), enter.shape[-1]
    white = base.filter.whiten(enter * base.linear.seen[..., None], np.zeros((*base.linear.defect.shape, n)))
    return Projection.shared(evidence, {r: white[:, r].reshape(-1, n) for r in range(len(base.batch.names))})


def _sizes(information: np.ndarray, match: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    return scaled_inverse(information[np.ix_(chosen, chosen)]) @ match[list(chosen)]
