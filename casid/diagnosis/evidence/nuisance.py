"""Small errors of instruments, which are no causes, but without which causes would be misjudged.

These are small offsets, and delays of a few milliseconds between attitudes and rates, which every instrumentation has.
Several small offsets together can imitate turbulence, and an offset of the accelerometers can imitate the effect of a
few milliseconds on a bank angle. They are listed under `minor`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import Projection
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.hypothesis import Attached, readings
from casid.filtering.kernel import WHOLE
from casid.model.causes.instruments import sensor_delay
from casid.model.effect import Effect

_UNIT = ("inertial",)
_ATTITUDES = ("phi", "theta", "psi")
SKEWED = (*_UNIT, "attitude", *_ATTITUDES)  # groups that may be milliseconds late without a fault


def demanded_offsets(base: FlightFit) -> list[Attached]:
    """Instrument offsets that improve the fit significantly and are too small to matter, with predicted values."""
    channels = base.model.outputs
    enter = np.broadcast_to(np.eye(len(channels)), (*base.read.shape, len(channels)))
    return _demanded(base, base.flight.offsets, enter)[0]


def demanded_skews(reconstructed: FlightFit) -> tuple[list[Attached], float]:
    """Delays of a few milliseconds of the inertial unit, or of the attitudes, that the kinematics find.

    The inertial unit may be late against all other channels, or the attitudes against the rates that they are the
    integrals of, together or each by a time of its own. The group that explains more is returned. Without attitudes
    such a delay cannot be separated from another position of the vanes, and nothing is returned.

    gain  decrease of the deviance, less what each delay of the group must gain
    """
    fit = reconstructed
    outputs = reconstructed.model.outputs
    attitudes = [c for c in _ATTITUDES if c in outputs]
    step = float(np.median(fit.batch.dt))  # readings are linear between samples
    found = [(list[Attached](), 0.0)]
    for group in (_UNIT, ("attitude",), attitudes) if attitudes else ():
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
    gained  decrease of the deviance by all chosen effects, less what each of them must gain
    """
    taken = {a.effect.key for a in base.attached}
    offered = [i for i, e in enumerate(effects) if e.key not in taken]
    if not offered:
        return [], 0.0
    left = _projected(base, enter[..., offered])
    information = left.gram
    match = left.match
    squares = float(np.sum(base.white**2))
    chosen = list[int]()
    sizes = np.zeros(0)
    gained = 0.0
    while len(chosen) < len(offered):
        others = [i for i in range(len(offered)) if i not in chosen]
        gains = [float(_sizes(information, match, [*chosen, i]) @ match[[*chosen, i]]) for i in others]
        misfit = max(1.0, (squares - max(gains)) / base.readings)
        if max(gains) - gained < base.criteria.significance.search * misfit:
            break
        chosen.append(others[int(np.argmax(gains))])
        sizes = _sizes(information, match, chosen)
        gained = max(gains)
    found = [
        Attached(effect=effects[offered[i]], values={"value": float(size)}, nuisance=True)
        for i, size in zip(chosen, sizes, strict=True)
    ]
    matters = base.flight.smallest_that_matters
    small = [one for one in found if abs(one.values["value"]) < (matters(one.effect) or 0.0)]
    return small, gained - base.criteria.significance.search * len(chosen)


def _projected(base: FlightFit, enter: np.ndarray) -> Projection:
    """Normal equations of responses `enter` (N, R, ny, n) to the readings, fitted parameters eliminated."""
    (N, R, _, n), seen = enter.shape, base.seen[..., None]
    together = max(WHOLE // R, 1)
    nothing = np.zeros((together, *base.linear.defect.shape[1:], n))
    parts = (slice(first, min(first + together, N)) for first in range(0, N, together))
    entering = ((at, enter[at] * seen[at], nothing[: N - 1 - at.start]) for at in parts)
    return Projection.shared(weigh(base, discrepancy=False), base.filter.whiten_in_stretches(entering, n))


def _sizes(information: np.ndarray, match: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    """Estimated sizes of the chosen effects."""
    return scaled_inverse(information[np.ix_(chosen, chosen)]) @ match[list(chosen)]
