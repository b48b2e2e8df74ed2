"""Structure that every real aircraft has and that a linear aircraft file leaves out: no cause, but in the way.

A parabolic drag polar, and the roll due to yaw rate and yaw due to roll rate that grow with lift (strip theory), are
put into the model before anything is named when the data demand them. They stand under `minor`.
"""

from __future__ import annotations

import numpy as np

from casid.diagnosis.evaluation import Fit
from casid.diagnosis.evidence import weigh
from casid.diagnosis.hypothesis import Attached
from casid.diagnosis.screening import Screen, fingerprints
from casid.model.causes import aero_term
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
