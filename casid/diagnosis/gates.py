"""The rules of comparisons that need more than a value and a threshold.

The functions take the numbers that are compared, and fit nothing; `engine/acceptance.py` selects those of a
cause alone, and which of a set of causes.
"""

from __future__ import annotations

import math

from casid.diagnosis import comparisons as ask
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect


def predicted_size(
    effect: Effect, share: float, statistic: float, clear: float, criteria: Criteria
) -> tuple[Gate, ...]:
    """Ask the predicted size of a cause that is to be fitted: its share of what matters, and its clearness."""
    least = criteria.parts.third
    gates = (ask.PREDICTED_SIZE.of(share, least, "parts.third"),)
    if effect.of_an_instrument:
        return gates
    return (*gates, ask.PREDICTED_CLEARNESS.of(share**2 * statistic / clear, least, "parts.third"))


def promises_enough(part: float, criteria: Criteria) -> Gate:
    """The gate on what the full model predicts of a fit, over what a name and the best fit so far ask of it."""
    return ask.PROMISE.of(part, criteria.parts.third, "parts.third")


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net likelihood-ratio statistic that a cause must reach to be named.

    Against a stated uncertainty it is that of a value beyond it: neither noise nor a choice of shapes enters.
    """
    if effect.size.stated:
        return criteria.significance.sigmas**2
    return criteria.significance.search


def _name_of_required(effect: Effect) -> str:
    """Name of the criterion of `required_gain`."""
    if effect.size.stated:
        return "significance.chance"
    return "significance.search"


def clear_gain(effect: Effect, criteria: Criteria, noise_by_fit: bool) -> float:
    """Likelihood-ratio statistic at which a cause of the smallest size that matters counts as clear.

    The value is larger if the noise was estimated with the model. Structural errors are then part of the residuals but
    not of the noise, and a negligible cause can be many standard deviations from zero. A statistic against a stated
    uncertainty is that of the value itself.
    """
    if effect.size.stated:
        return required_gain(effect, criteria)
    return criteria.significance.search if noise_by_fit else criteria.size.clear


def gain(effect: Effect, decisive: float, left_by_others: float, required: float, criteria: Criteria) -> Gate:
    """Ask the likelihood-ratio statistic of a fitted cause in the presence of causes named earlier.

    The misfit that remains because an earlier cause (the largest statistic is `left_by_others`), or turbulence
    (`required`), has only an approximate shape is no evidence for another cause.
    """
    prices = {
        _name_of_required(effect): required_gain(effect, criteria),
        "naming.approximate": required,
        "structure.known": criteria.structure.known * left_by_others,
    }
    highest = max(prices, key=lambda name: prices[name])
    return ask.GAIN.of(decisive, prices[highest], highest)


def probable(effect: Effect, decisive: float, inflation: float, criteria: Criteria) -> Gate:
    """Ask the likelihood-ratio statistic of a named cause with correlated residuals counted, as its probability does.

    At the statistic that a name takes, the odds are those at which a wrong name costs as much as a missed one. A cause
    with less is not probable enough for a name.
    """
    required = required_gain(effect, criteria)
    where = ", correlated residuals counted"
    return ask.GAIN.of(decisive / inflation, required, _name_of_required(effect), where=where)


def possible(one: Attached, part: float = 1.0) -> tuple[Gate, ...]:
    """Ask that the values of an effect are physically possible.

    Of a predicted size only a `part` must not be too large: a fit may find less than the prediction.
    """
    effect = one.effect
    size = part * one.values["value"]
    where = "" if part == 1.0 else f", of {part:.2g} times the predicted one"
    lowest = -effect.size.limit if effect.size.lowest is None else effect.size.lowest
    gates = (
        ask.SMALLEST.of(size, lowest, where=f" value{where}"),
        ask.LARGEST.of(size, effect.size.limit, where=f" value{where}"),
        *(
            ask.LARGEST.of(abs(one.values[name]), most, where=f" {name}{where}")
            for name, most in effect.size.limits.items()
        ),
    )
    finite = tuple(gate for gate in gates if math.isfinite(gate.threshold))
    return finite if part == 1.0 else tuple(gate for gate in finite if not gate.least or gate.threshold < 0.0)


def is_possible(one: Attached) -> bool:
    """Return True if the values of an effect are physically possible."""
    return all_passed(possible(one))


def clear_size(
    share: float, statistic: float, clear: float, criteria: Criteria, unlike_aerodynamics: bool = False
) -> tuple[Gate, ...]:
    """Ask that a size matters (`share` is in units of the smallest that does) and is clear enough.

    The second gate is omitted for a cause that nothing in the aerodynamics can imitate (`unlike_aerodynamics`).
    """
    matters = ask.MATTERS.of(share, 1.0, "size.share")
    if unlike_aerodynamics:
        return (matters,)
    names = {criteria.size.clear: "size.share", criteria.significance.search: "significance.search"}
    return matters, ask.CLEARNESS.of(share**2 * statistic, clear, names.get(clear, "significance.chance"))


def seen_by_kinematics(predicted: float, achieved: float, criteria: Criteria) -> tuple[Gate, ...]:
    """Ask the kinematics to find enough of a cause that they see clearly."""
    by = criteria.significance
    if predicted <= by.search:
        return ()
    fits = ask.CONTRADICTED_SIZE.of(contradiction(predicted, achieved), by.search, "significance.search")
    least = criteria.parts.third
    return (ask.FOUND_BY_KINEMATICS.of(achieved / predicted, least, "parts.third", [fits]),)


def contradiction(predicted: float, achieved: float) -> float:
    """Chi-square between the sizes of a cause according to the kinematics and to the full model."""
    return (predicted - achieved) ** 2 / (4.0 * predicted)


def still_missing(before: float, left: float, criteria: Criteria, where: str = "", flexible: bool = False) -> Gate:
    """Ask that at most a part of what was missing at a port is still missing, or no more than noise.

    `before` and `left` are the likelihood-ratio statistics of the latent input before and after the cause; less may
    remain beside a cause that is `flexible` enough to imitate others.
    """
    most = criteria.parts.tenth if flexible else criteria.parts.quarter
    name = "parts.tenth" if flexible else "parts.quarter"
    noise = no_more_than_noise(left, criteria)
    return ask.STILL_MISSING.of(left / max(before, 1e-300), most, name, [noise], where)


def no_more_than_noise(left: float, criteria: Criteria) -> Gate:
    """Ask that the statistic of a latent input is no more than that of noise."""
    return ask.MISSING_GAIN.of(left, criteria.missing, "parts.third")
