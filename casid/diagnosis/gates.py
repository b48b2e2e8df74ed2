"""Every comparison by which a cause is named or refused, in the order in which a diagnosis asks them.

The functions take the numbers that are compared, and fit nothing; `engine/acceptance.py` selects those of a
cause alone, and which of a set of causes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace

from casid.diagnosis.cause import Gate, all_passed, at_least, at_most
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect

# --- what the data are worth ------------------------------------------------------------------------------------------


def odds_against_good_records(odds: float) -> Gate:
    """Ask the odds of a fault of the data against records without one."""
    return at_least("odds against records that are well", odds, 1.0)


def refused_by_the_data(because: str) -> Gate:
    """State why no cause is named where the data are at fault."""
    return at_most(because, 1.0, 0.0)


# --- before a fit -----------------------------------------------------------------------------------------------------


def predicted_statistic(net: float, criteria: Criteria) -> Gate:
    """Ask the score statistic of a cause that is to be fitted."""
    by = criteria.naming
    return at_least("predicted statistic", net, by.tried * by.gain, "naming.tried")


def predicted_size(
    effect: Effect, share: float, statistic: float, clear: float, criteria: Criteria
) -> tuple[Gate, ...]:
    """Ask the predicted size of a cause that is to be fitted: its share of what matters, and its clearness."""
    least = criteria.naming.tried
    gates = (at_least("predicted size", share, least, "naming.tried"),)
    if effect.of_an_instrument:
        return gates
    return (*gates, at_least("predicted clearness", share**2 * statistic / clear, least, "naming.tried"))


def place_left(places: int, terms: bool = False) -> Gate:
    """Ask for a place among the causes that are fitted, or among the `terms` of one coefficient."""
    return at_least(f"places left among {'terms of its coefficient' if terms else 'those tried'}", places, 1.0)


def beside_turbulence(effect: Effect, net: float, required: float, criteria: Criteria) -> tuple[Gate, ...]:
    """Ask the score statistic beside the misfit of an approximate model of turbulence (`required`)."""
    if effect.kinematic:
        return ()
    return (at_least("predicted statistic beside turbulence", net, criteria.naming.tried * required, "naming.tried"),)


def worth_fitting(predicted: float, achieved: float, criteria: Criteria) -> Gate:
    """Ask the kinematics for a part of a cause, at half of its predicted size."""
    least = criteria.kinematics.refuted
    return at_least("found by kinematics at half its size", achieved / predicted, least, "kinematics.refuted")


def cannot_be_flown() -> Gate:
    """State that the model with a cause diverges on a record."""
    return at_least("records that can be simulated with it", 0.0, 1.0)


def no_time_left() -> Gate:
    """State that the time for the search is over."""
    return at_least("time left", 0.0, 1.0)


def promises_enough(part: float, criteria: Criteria) -> Gate:
    """The gate on what the full model predicts of a fit, over what a name and the best fit so far ask of it."""
    return at_least("predicted statistic, of what it needs", part, criteria.naming.tried, "naming.tried")


# --- a fitted cause alone ---------------------------------------------------------------------------------------------


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net likelihood-ratio statistic that a cause must reach to be named.

    Against a stated uncertainty it is that of a value beyond it: neither noise nor a choice of shapes enters.
    """
    if effect.size.stated:
        return criteria.significance.sigmas**2
    return criteria.naming.gain_of_an_instrument if effect.of_an_instrument else criteria.naming.gain


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
        "naming.gain_of_an_instrument" if effect.of_an_instrument else "naming.gain": required_gain(effect, criteria),
        "naming.approximate": required,
        "naming.left_to_others": criteria.naming.left_to_others * left_by_others,
    }
    highest = max(prices, key=lambda name: prices[name])
    return at_least("gain", decisive, prices[highest], highest)


def possible(one: Attached) -> tuple[Gate, ...]:
    """Ask that the values of an effect are physically possible."""
    effect = one.effect
    values = one.values
    lowest = -effect.size.limit if effect.size.lowest is None else effect.size.lowest
    gates = (
        at_least("smallest possible value", values["value"], lowest),
        at_most("largest possible value", values["value"], effect.size.limit),
        *(at_most(f"largest possible {name}", abs(values[name]), most) for name, most in effect.size.limits.items()),
    )
    return tuple(gate for gate in gates if math.isfinite(gate.threshold))


def possible_in_part(one: Attached) -> tuple[Gate, ...]:
    """Ask that half of a predicted size is not too large to be possible; a fit may find less than the prediction."""
    half = one.with_values({"value": 0.5 * one.values["value"]})
    too_large = (gate for gate in possible(half) if not gate.least or gate.threshold < 0.0)
    return tuple(replace(gate, gate=f"{gate.gate}, of half the predicted one") for gate in too_large)


def matters(share: float) -> Gate:
    """Ask that a size matters; `share` is in units of the smallest that does."""
    return at_least("size, of what matters", share, 1.0, "size.share")


def clear_size(
    share: float, statistic: float, clear: float, criteria: Criteria, unlike_aerodynamics: bool = False
) -> tuple[Gate, ...]:
    """Ask that a size matters and is clear enough.

    The second gate is omitted for a cause that nothing in the aerodynamics can imitate (`unlike_aerodynamics`).
    """
    if unlike_aerodynamics:
        return (matters(share),)
    names = {criteria.size.clear: "size.share", criteria.significance.search: "significance.search"}
    name = names.get(clear, "significance.chance")
    return matters(share), at_least("clearness", share**2 * statistic, clear, name)


def remembered(one: Attached, interval: float) -> tuple[Gate, ...]:
    """Ask that the lag of a further state lasts from one sample to the next, `interval` [s] later.

    A shorter one follows only what differs from sample to sample, which in moving air is mostly noise.
    """
    lags = [one.values[name] for name, unit in one.effect.units.items() if unit == "s"] if one.effect.states else []
    return tuple(at_least("lag of a state, in sampling intervals", lag / interval, 1.0) for lag in lags)


def begins_inside(latest: float, criteria: Criteria) -> Gate:
    """Ask that an event begins after the beginning of a record, by `latest` [s] at most."""
    least = criteria.numerics.events.fine
    return at_least("onset after the beginning of a record", latest, least, "numerics.events.fine")


def sudden(over_slow: float, criteria: Criteria) -> Gate:
    """Ask that the statistic of a jump clearly exceeds that of a slow change of the same effect."""
    least = 1.0 / criteria.numerics.events.sudden
    return at_least("gain of the jump over a slow change", over_slow, least, "numerics.events.slow_polynomials")


def alone(over_others: float, criteria: Criteria) -> Gate:
    """Ask that the statistic of a gust is significant in units of those that gusts have at all other times."""
    return at_least("gain of the gust over those at other times", over_others, criteria.significance.search)


# --- the kinematics, which contain no aerodynamics --------------------------------------------------------------------


def contradiction(predicted: float, achieved: float) -> float:
    """Chi-square between the sizes of a cause according to the kinematics and to the full model."""
    return (predicted - achieved) ** 2 / (4.0 * predicted)


def seen_by_kinematics(predicted: float, achieved: float, criteria: Criteria) -> tuple[Gate, ...]:
    """Ask the kinematics to find enough of a cause that they see clearly, or not to oppose its size."""
    by = criteria.significance
    least = criteria.kinematics.refuted
    if predicted > by.search:
        fits = at_most("contradicted size", contradiction(predicted, achieved), by.search, "significance.search")
        return (at_least("found by kinematics", achieved / predicted, least, "kinematics.refuted", [fits]),)
    if predicted <= by.chance:
        return ()
    agree = at_least("kinematic gain", achieved, 0.0)
    opposed = contradiction(predicted, achieved)
    return (at_most("opposed by kinematics", opposed, by.chance, "significance.chance", [agree]),)


def must_be_seen(predicted: float, achieved: float, criteria: Criteria) -> tuple[Gate, ...]:
    """Ask the kinematics to see a cause that only they can separate from forces."""
    least = criteria.significance.chance
    return (
        at_least("predicted kinematic gain", predicted, least, "significance.chance"),
        at_least("kinematic gain", achieved, 0.0),
    )


# --- the last cause of a set ------------------------------------------------------------------------------------------


def sure(ratio: float, criteria: Criteria) -> Gate:
    """Ask that zero is more than three corrected deviations away from a value."""
    by = criteria.significance
    return at_least("size, in corrected standard deviations", ratio, by.sigmas, "significance.chance")


def still_missing(before: float, left: float, criteria: Criteria, part: str = "doubt.left", where: str = "") -> Gate:
    """Ask that at most a part of what was missing at a port is still missing, or no more than noise.

    `before` and `left` are the likelihood-ratio statistics of the latent input before and after the cause; `part` names
    the criterion of the largest permitted ratio.
    """
    most = criteria.doubt.left_by_terms if part == "doubt.left_by_terms" else criteria.doubt.left
    noise = at_most("gain still missing", left, criteria.verdict.missing, "verdict.missing")
    return at_most(f"part still missing{where}", left / max(before, 1e-300), most, part, [noise])


def nothing_left(gain: float, size: float, criteria: Criteria) -> Gate:
    """Ask that nothing that matters is missing at the port of a cause of last resort, or no more than noise."""
    noise = at_most("gain still missing", gain, criteria.verdict.missing, "verdict.missing")
    return at_most("size still missing at its port, of what matters", size, 1.0, "size.share", [noise])


def largest_missing(left: float, total: float) -> Gate:
    """Ask that no latent input still has more statistic than a cause that helped at no port most."""
    return at_most("largest gain still missing, of it", left / max(total, 1e-300), 1.0)


def as_much_as_any_input(raw: float, most: float) -> Gate:
    """Ask that a cause has the statistic of a latent input of any shape at its port."""
    return at_least("gain, of what any input gains there", raw / max(most, 1e-300), 1.0)


def confirmed_by_kinematics(confirmed: bool = True) -> Gate:
    """State whether the kinematics confirm a cause."""
    return at_least("confirmed by kinematics", float(confirmed), 1.0)


def nothing_worse(place: str, size: float) -> Gate:
    """Ask that what is newly missing at a place does not matter."""
    return at_most(f"size newly missing at {place}, of what matters", size, 1.0, "size.share")


def no_single_drift(drift: float, raw: float, criteria: Criteria) -> Gate:
    """Ask that turbulence has more statistic than the drift of any single reading."""
    most = criteria.turbulence.one_reading
    return at_most("gain of one drifting reading, of it", drift / max(raw, 1e-300), most, "turbulence.one_reading")


def stands_beside(distance: float) -> Gate:
    """Ask that an alternative is near enough to the best cause to be in one ambiguity set with it."""
    return at_most("gain behind the first, of what is equivalent", distance, 1.0, "screening.equivalent")


def none_refused(refused: Collection[str]) -> Gate:
    """Ask that no cause of a set was refused: the others were judged beside it."""
    return at_most(f"refused causes of its set ({', '.join(refused)})", len(refused), 0.0)


def best_of_its_forms() -> Gate:
    """State that another form of a cause, or the same in other records, explains more."""
    return at_least("best of the forms of this cause", 0.0, 1.0)


def tried_again_beside(small: str) -> Gate:
    """State that a fault that is too small to matter explains more, so that a later round decides beside it."""
    return at_least(f"decided before {small}, which is too small to matter", 0.0, 1.0)


def first_is_named(first: str) -> Gate:
    """State that the first cause of an ambiguity set was not named, and so neither was the set."""
    return at_least(f"first of its set is named ({first})", 0.0, 1.0)


# --- the final model and the held-out records -------------------------------------------------------------------------


def in_the_final_model(gates: Iterable[Gate]) -> tuple[Gate, ...]:
    """Name the gates that are asked again beside all other causes."""
    return tuple(replace(gate, gate=f"{gate.gate}, in the final model") for gate in gates)


def gone_beside_later_causes() -> Gate:
    """State that later causes made a cause unnecessary."""
    return at_least("still in the model beside later causes", 0.0, 1.0)


def borne_out(gain_on_held_out: float) -> Gate:
    """Ask that the held-out records do not speak against a cause more than the fitted ones speak for it."""
    return at_least("gain with held-out records", gain_on_held_out, 0.0)


def beside_slow_noise(share: float) -> Gate:
    """Ask the statistic of a cause where the noise is as slow as the residuals, over that of a name."""
    return at_least("gain where noise is slow, of that for a name", share, 1.0, "naming.gain")


def unusual(usual: bool) -> Gate:
    """Ask that structure which every aircraft has is larger than usual."""
    return at_most("expected of any aircraft", float(usual), 0.0)


def gain_of_structure(statistic: float, required: float) -> Gate:
    """Ask that such structure has more statistic than the misfit of turbulence (`required`)."""
    return at_least("gain", statistic, required, "naming.approximate")


def gain_held_out(held: float | None) -> Gate:
    """Ask that such structure does not lose on the held-out records."""
    return at_least("gain on held-out records", held or 0.0, 0.0)


def follows_inputs(statistic: float, criteria: Criteria) -> Gate:
    """Ask how far innovations in moving air follow earlier changes of the inputs, which no air does."""
    return at_least("gain of earlier inputs on the innovations", statistic, criteria.verdict.missing, "verdict.missing")


def common(statistic: float, criteria: Criteria) -> Gate:
    """Ask that one number for many values is clearly likelier than errors that have nothing to do with each other."""
    return at_least("odds against single errors, 2 ln", statistic, criteria.significance.chance, "significance.chance")


def unexplained(gain: float, size: float, told: bool, unknown: bool, criteria: Criteria) -> tuple[Gate, ...]:
    """Ask that a latent input of the final model is there, matters, and is left beside everything else."""
    gates = (
        at_least("gain of an input of any shape", gain, criteria.verdict.missing, "verdict.missing"),
        matters(size),
        at_least("left beside causes, slow noise and turbulence", float(told), 1.0),
    )
    return (*gates, at_most("never recorded, and so not judged", 1.0, 0.0)) if unknown else gates


def is_possible(one: Attached) -> bool:
    """Return True if the values of an effect are physically possible."""
    return all_passed(possible(one))
