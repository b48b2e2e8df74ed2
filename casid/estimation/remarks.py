"""What a person should know of a fit that its status does not say: channels that it misses, values that contradict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from casid.estimation.cost import OutputError, RangeWeights
from casid.estimation.fitted import ChannelFit, Estimate
from casid.estimation.problem import Problem
from casid.model.numbers import with_deviation

_FAR = 3.0  # a-priori deviations: 3 in 1000 are as far by chance
_SURE = 2.0  # standard errors: the sign is known
_UNEXPLAINED = 2.0  # times the given noise: chosen; by chance a hundred samples are not beyond 1.3


def remarks(
    problem: Problem,
    channels: Mapping[str, ChannelFit],
    parameters: Mapping[str, Estimate],
    *,
    converged: bool,
    misfit: float,
    many_starts: bool,
) -> tuple[str, ...]:
    """One sentence each, none when all is well: channels that their own mean explains better, parameters three a-priori
    deviations from the file or of the opposite sign, standard errors that no sample is left for.

    `misfit` is half the sum of squares of weighted residuals; `many_starts`: whether other minima were looked for.
    """
    found = [*_channels(channels), *_parameters(problem, parameters)]
    if not converged:
        return tuple(found)
    samples = sum(channel.samples for channel in channels.values())
    return (*_noise(problem, misfit, samples, many_starts), *found, *_errors(parameters))


def _noise(problem: Problem, misfit: float, samples: int, many_starts: bool) -> Iterator[str]:
    """Residuals that a given noise does not explain: the model is wrong, or the minimum is not the lowest."""
    if problem.noise is None or isinstance(problem.noise, str | RangeWeights):
        return
    times = math.sqrt(max(2.0 * misfit, 0.0) / samples)
    if times > _UNEXPLAINED and isinstance(problem.cost, OutputError):
        tried = "" if many_starts else ": solve(..., starts=20) tells"
        yield (
            f"the residuals are {times:.2g} times the given noise: the model cannot follow these data, or another "
            f"minimum is lower{tried}"
        )


def _channels(channels: Mapping[str, ChannelFit]) -> Iterator[str]:
    for name, channel in channels.items():
        if channel.R2 < 0.0:
            yield f"{name}: R2 is {channel.R2:.2g}, its own mean explains it better than the model"
        elif math.isnan(channel.R2):
            yield f"{name}: measured as constant; nothing can be learnt from it"


def _parameters(problem: Problem, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    known = problem.model.prior_std
    for name, e in parameters.items():
        std = known.get(name.split("[")[0], math.inf)
        far = abs(e.value - e.prior) / std if std > 0.0 else 0.0
        error = e.std_corrected if math.isfinite(e.std_corrected) else 0.0
        opposite = e.value * e.prior < 0.0 and abs(e.value) > _SURE * error
        stated = f" +- {std:.2g}" if math.isfinite(std) else ""
        numbers = f"{with_deviation(e.value, error)} against {e.prior:.4g}{stated}"
        if opposite:
            yield f"{name}: of the opposite sign of its a-priori value, {numbers}"
        elif far >= _FAR:
            yield f"{name}: {far:.1f} a-priori deviations from its a-priori value, {numbers}"


def _errors(parameters: Mapping[str, Estimate]) -> Iterator[str]:
    if all(math.isnan(e.std) for e in parameters.values()):
        yield "no standard errors: as many unknowns as samples, and the noise is estimated with them"
