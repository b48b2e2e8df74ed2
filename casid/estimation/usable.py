"""Judge in one word whether the estimates of a fit can be used, with the reasons."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.estimation.remarks import against_prior
from casid.estimation.solvers.status import Results
from casid.records.noise import high_band_sigma

USABLE = "usable"
STRUCTURE_MISSING = "structure missing"
NOT_IDENTIFIABLE = "not identifiable"
NOT_CONVERGED = "not converged"

_BY_CHANCE = 9.0  # samples times -R2 that a right model reaches: three standard errors of the mean
_UNEXPLAINED = 0.1  # of the variance of a motion, from which a model lacks structure: chosen
_MOVES = 2.0  # standard deviations over the noise, from which a channel has a motion
_OF_THE_FILE = 0.95  # of the a-priori standard deviation: the data say less of a parameter than the file


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The verdict on a fit, and the reasons for it; those of "usable" are what to mind."""

    verdict: str
    because: tuple[str, ...]


def judge(fit: Any) -> Judgement:
    """Return the verdict on a fit: the first that holds of not identifiable, not converged and structure missing."""
    idle = [name for name, e in fit.parameters.items() if not math.isfinite(e.std)]
    from_file = [n for n, e in fit.parameters.items() if n not in idle and e.std > _OF_THE_FILE * e.prior_std]
    against = tuple(against_prior(fit.problem, fit.parameters))
    ended = f"{fit.reason}: {fit.remedy}" if fit.reason and fit.remedy else fit.reason or fit.remedy
    worse = tuple(_worse_than_mean(fit))
    unexplained = tuple(_unexplained(fit)) if fit.problem.simulated else ()
    little = f"these data say less of {', '.join(from_file)} than the file" if from_file else ""
    notes = (*against, *((little,) if little else ()))
    if fit.result is Results.NOT_IDENTIFIABLE:
        return Judgement(verdict=NOT_IDENTIFIABLE, because=(ended, *worse, *notes))
    if not fit.converged:
        return Judgement(verdict=NOT_CONVERGED, because=(ended, *worse, *against))
    if worse:
        return Judgement(verdict=NOT_CONVERGED, because=(*worse, *unexplained, *against))
    if idle or (from_file and len(from_file) == len(fit.parameters)):
        none = (f"no standard error exists of {', '.join(idle)}",) if idle else ()
        return Judgement(verdict=NOT_IDENTIFIABLE, because=(*none, *unexplained, *notes))
    if unexplained or (against and fit.uncertainty.coloured_channels):
        return Judgement(verdict=STRUCTURE_MISSING, because=(*unexplained, *notes))
    return Judgement(verdict=USABLE, because=notes)


def _worse_than_mean(fit: Any) -> Iterator[str]:
    """Channels that their own mean explains better than the model, by more than chance."""
    for name, channel in fit.channels.items():
        if channel.R2 * channel.samples < -_BY_CHANCE:
            yield f"{name}: R2 is {channel.R2:.2g}, its own mean explains it better than the model"


def _unexplained(fit: Any) -> Iterator[str]:
    """Channels of which more than a tenth of the motion is left, worst first."""
    found = []
    for i, (name, channel) in enumerate(fit.channels.items()):
        measured = [fit.predictions[r][:, i] + fit.residuals[r][:, i] for r in fit.residuals]
        sigmas = [high_band_sigma(one) for one in measured]
        sigmas = [one for one in sigmas if math.isfinite(one)]
        if not sigmas or not math.isfinite(channel.R2) or channel.R2 >= 1.0:
            continue
        noise = float(np.median(sigmas))
        variance = channel.rms**2 / (1.0 - channel.R2)
        if variance < (_MOVES * noise) ** 2:
            continue
        left = (channel.rms**2 - noise**2) / (variance - noise**2)
        if left > _UNEXPLAINED:
            times = f", {channel.rms / noise:.2g} times its noise" if noise > 0.0 else ""
            found.append((left, f"{name}: {100.0 * left:.0f} % of its motion is not explained{times}"))
    yield from (text for _, text in sorted(found, reverse=True))
