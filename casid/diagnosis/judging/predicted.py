"""How likely records that no fit has seen are, given those that were fitted: what the fit left open included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.fit import all_free


@dataclass(frozen=True, eq=False, kw_only=True)
class Predicted:
    """A fitted model on held-out records: their `fit`, in which nothing but the motion is fitted, and the `deviance`
    -2 ln p(held-out readings | fitted ones), up to a constant of the data."""

    fit: FlightFit
    deviance: float


def predicted(held: FlightFit, fitted: FlightFit) -> Predicted:
    """The density is that of the model linearised about its values, with these, and small terms of the structure, as
    uncertain and as correlated as the fitted records leave them (the posterior predictive density).

    By the values alone, a cause that is right loses where the fitted records tell little of the derivatives that decide
    on the held-out ones: an aileron manoeuvre does not tell what the rudder does.
    """
    known, there = weigh(fitted), weigh(all_free(held))
    mean, information = _expected(known, there)
    gram, slope = _data(there)
    posterior = gram + information
    pull = slope + information @ mean
    moved = float(mean @ information @ mean) - float(pull @ scaled_inverse(posterior) @ pull)
    volume = np.linalg.slogdet(posterior)[1] - np.linalg.slogdet(information)[1]
    return Predicted(fit=held, deviance=there.fit.data_deviance + moved + float(volume))


def _data(there: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of slots and small terms by the held-out readings alone."""
    gram, slope, k = there.sums.gram.copy(), there.sums.slope.copy(), len(there.fit.slots)
    gram[range(k), range(k)] -= there.fit.prior_weight
    slope[:k] += there.fit.prior_pull
    return gram, slope


def _expected(known: Evidence, there: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """(mean, information) of the slots and small terms of the held-out evidence by the fitted records; what these know
    nothing of has its prior."""
    names, before = _names(there), _names(known)
    both = [name for name in names if name in before]
    at: np.ndarray = np.array([names.index(name) for name in both], dtype=int)
    of: np.ndarray = np.array([before.index(name) for name in both], dtype=int)
    unit = (
        np.r_[np.ones(len(known.fit.slots)), known.factors][of]
        / np.r_[np.ones(len(there.fit.slots)), there.factors][at]
    )
    scale = np.array([known.scales.get(c, 1.0) for c, _ in there.terms])
    prior = np.asarray(block_diag(np.diag(there.fit.prior_weight), there.small_information / scale[:, None] / scale))
    mean = np.zeros(len(names))
    mean[at] = known.newton[of] * unit
    information = np.zeros((len(names), len(names)))
    others = np.array([i for i, name in enumerate(names) if name not in before], dtype=int)
    information[others[:, None], others] = prior[others[:, None], others]
    information[at[:, None], at] = scaled_inverse(known.covariance[of[:, None], of] * unit[:, None] * unit)
    return mean, information


def _names(evidence: Evidence) -> list[object]:
    return [*(slot.name for slot in evidence.fit.slots), *evidence.terms]
