"""Structure that every real aircraft has and a linear aircraft file lacks.

These terms are not causes, but without them causes would be misjudged. They are added before the search if the records
require them: a parabolic drag polar; the roll due to yaw rate and the yaw due to roll rate that grow with lift (strip
theory); small offsets of the instruments; and delays of a few milliseconds between attitudes and rates, which every
instrumentation has. Several small offsets together can imitate turbulence, and an offset of the accelerometers can
imitate the effect of a few milliseconds on a bank angle. All of them are listed under `minor`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import Projection, fingerprints
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.flight import of_aircraft
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
SKEWED = (*_UNIT, *_ATTITUDES)  # groups that may be milliseconds late without a fault


def is_usual(effect: Effect) -> bool:
    """Whether an effect is structure that every aircraft has."""
    return effect.regressor is not None and effect.regressor in _EXPECTED.get(effect.target, ())


def is_induced_drag(effect: Effect, value: float, fit: FlightFit) -> bool:
    """Whether a drag term of alpha^2 is no larger than induced drag.

    The limit is CL_alpha^2 / (pi A e) with the aspect ratio A and the lowest Oswald factor e of real wings.
    """
    if (effect.target, effect.regressor) != ("CD", "alpha^2"):
        return False
    aircraft = of_aircraft(fit.flight).aircraft
    lift = fit.derivatives.get("CL_alpha", aircraft.derivatives.get("CL_alpha", 0.0))
    aspect = aircraft.area / aircraft.moment_length_pitch**2
    return 0.0 <= value <= lift**2 / (np.pi * aspect * fit.criteria.structure.oswald)


def demanded_structure(base: FlightFit) -> list[Attached]:
    """Expected terms that the aircraft file lacks and that improve the fit significantly, with predicted values."""
    aircraft = of_aircraft(base.flight).aircraft
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
        if statistic > base.criteria.naming.gain:
            found.append(Attached(effect=one.effect, values={"value": size}))
    return found


def demanded_offsets(base: FlightFit) -> list[Attached]:
    """Instrument offsets that improve the fit significantly and are too small to matter, with predicted values."""
    channels = base.model.outputs
    enter = np.broadcast_to(np.eye(len(channels)), (*base.read.shape, len(channels)))
    return _demanded(base, base.flight.offsets, enter)[0]


def demanded_skews(reconstructed: FlightFit) -> tuple[list[Attached], float]:
    """Delays of a few milliseconds of the inertial unit, or of the attitudes, that the kinematics find.

    The inertial unit may be late against all other channels, or the attitudes against the rates that they are the
    integrals of. The group that explains more is returned. Without attitudes such a delay cannot be separated from
    another position of the vanes, and nothing is returned.

    gain  decrease of the deviance
    """
    fit, outputs = reconstructed, reconstructed.model.outputs
    attitudes = [c for c in _ATTITUDES if c in outputs]
    step = fit.criteria.numerics.naming.skew_step * float(np.median(fit.batch.dt))
    found = [(list[Attached](), 0.0)]
    for group in (_UNIT, attitudes) if attitudes else ():
        late = [Attached(effect=sensor_delay(target), values={"value": step}) for target in group]
        read = [readings([a], fit.batch.names, fit.batch.t, fit.output, outputs, fit.known) for a in late]
        enter = (np.stack(read, axis=3) - fit.output[..., None]) / step
        found.append(_demanded(fit, [a.effect for a in late], enter))
    return max(found, key=lambda one: one[1])


def _demanded(base: FlightFit, effects: Sequence[Effect], enter: np.ndarray) -> tuple[list[Attached], float]:
    """Choose effects that improve the fit significantly and are too small to matter, by forward selection.

    Forward selection is used because the responses to some effects are nearly collinear. Effects that matter are chosen
    as well, so that small ones do not imitate them, but they are not returned; the search will find them.

    enter   (N, R, ny, effects) What a unit of each effect adds to the readings
    small   the chosen effects that are too small to matter, with predicted values
    gained  decrease of the deviance by all chosen effects
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
        if max(gains) - gained < base.criteria.naming.gain * misfit:
            break
        chosen.append(others[int(np.argmax(gains))])
        sizes, gained = _sizes(information, match, chosen), max(gains)
    found = [
        Attached(effect=effects[offered[i]], values={"value": float(size)}, nuisance=True)
        for i, size in zip(chosen, sizes, strict=True)
    ]
    matters = base.flight.smallest_that_matters
    small = [one for one in found if abs(one.values["value"]) < (matters(one.effect) or 0.0)]
    return small, gained


def _projected(base: FlightFit, enter: np.ndarray) -> Projection:
    """Normal equations of responses `enter` (N, R, ny, n) to the readings, fitted parameters eliminated."""
    evidence, n = weigh(base, discrepancy=False), enter.shape[-1]
    white = base.filter.whiten(enter * base.seen[..., None], np.zeros((*base.linear.defect.shape, n)))
    return Projection.shared(evidence, white)


def _sizes(information: np.ndarray, match: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    """Estimated sizes of the chosen effects."""
    return scaled_inverse(information[np.ix_(chosen, chosen)]) @ match[list(chosen)]
