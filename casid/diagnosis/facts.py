"""The facts of a diagnosis: numbers and names that are known when all fits are made, without conclusions.

Statements are made of these by `claims`, and the verdict by `verdict`. Neither fits anything.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from casid.data_check.reading import Finding
from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import PartCriteria
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.given.contradicted import Contradiction, FlightValue
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.given.scope import NotJudged
from casid.model.numbers import digits, with_deviation


@dataclass(frozen=True, kw_only=True)
class ChangedValue:
    """A value of the extended model beside that as given."""

    in_json: ClassVar[str] = "parameter unit given extended stated_std sigmas identifiable sentence"

    parameter: str  # parameter, unit: its name, and the unit of its values
    unit: str
    given: float  # given, extended: its value as given, and in the extended model
    extended: float
    stated_std: float  # its stated 1-sigma; 10 % of its value where none is stated
    identifiable: bool  # whether the records determine it better than the file does
    # channel -> r.m.s. change of the predicted readings by the move, in units of their noise.
    effect: Mapping[str, float] = field(default_factory=dict)

    @property
    def sigmas(self) -> float:
        """The change in units of the stated uncertainty; 0 where none is stated and the value is 0."""
        return abs(self.extended - self.given) / self.stated_std if self.stated_std > 0.0 else 0.0

    @property
    def change(self) -> str:
        """The move in a few words: in per cent, as a factor, or from one value to another."""
        ratio = self.extended / self.given if self.given else math.nan
        if not 0.0 < ratio < 10.0:
            return f"{self.parameter} {digits(self.given)} -> {digits(self.extended)}"
        return (
            f"{self.parameter} times {ratio:.2g}"
            if ratio >= 2.0
            else f"{self.parameter} {100.0 * (ratio - 1.0):+.0f} %"
        )

    @property
    def sentence(self) -> str:
        """The move as a sentence."""
        unit = f" {self.unit}" if self.unit not in ("", "1") and not self.unit.startswith("1/") else ""
        alone = "" if self.identifiable else "; the records alone do not determine it"
        return (
            f"{self.parameter} is {digits(self.given)}{unit} as given and {digits(self.extended)}{unit} in the "
            f"extended model, {digits(self.sigmas, 2)} times its stated uncertainty away{alone}."
        )


@dataclass(frozen=True, kw_only=True)
class Combination:
    """Two values that the records do not determine one by one, but of which they determine a ratio, product or sum."""

    parameters: tuple[str, str]  # the two names
    sentence: str  # what is determined, with its value as given and by the records


@dataclass(frozen=True, eq=False, kw_only=True)
class Facts:
    """Facts on which statements and verdict depend."""

    # source, witness: what the values are from, "file" or "model"; and what contradicts them, "flight" or "the
    # records"
    source: str
    witness: str
    budget: Budget  # errors on the held-out records, and by record
    criteria: PartCriteria = PartCriteria()  # thresholds of the simulation as given
    # at_fault, corrected: faults of the data that could not be corrected, and corrections
    at_fault: tuple[Finding, ...] = ()
    corrected: tuple[Finding, ...] = ()
    impossible: tuple[Contradiction, ...] = ()  # numbers of the file that no aircraft has
    # causes, minor: the causes that the gates let pass, and those that are real and too small to matter
    causes: tuple[Cause, ...] = ()
    minor: tuple[Cause, ...] = ()
    unexplained: tuple[str, ...] = ()  # sentences of what no cause explains, strongest first
    # contradicted, factors: values, and common factors of groups of values, that are inconsistent with the records
    contradicted: tuple[Contradiction, ...] = ()
    factors: tuple[Factor, ...] = ()
    # changed, combinations: values of the extended model beside those as given, and what is determined of pairs
    changed: tuple[ChangedValue, ...] = ()
    combinations: tuple[Combination, ...] = ()
    not_judged: tuple[NotJudged, ...] = ()  # what the records leave open
    turbulent: tuple[str, ...] = ()  # records in turbulence
    listed: int = 3  # largest number of items that a sentence lists

    @property
    def moved(self) -> tuple[ChangedValue, ...]:
        """The values that left their stated uncertainty."""
        return tuple(one for one in self.changed if one.sigmas > 1.0)


def changed_values(
    fit: FlightFit, given: Mapping[str, float], flight: Mapping[str, FlightValue], least: float
) -> tuple[ChangedValue, ...]:
    """Values of the extended model beside those as given, those with the largest effect on the readings first.

    `least` is the relative uncertainty of a value without a stated one.
    """
    units = fit.model.units
    found = []
    names = {one.name: one.effect.unit for one in fit.attached}
    for i, slot in enumerate(fit.slots):
        if slot.name not in given or slot.name not in flight:
            continue
        weight = float(fit.prior_weight[i])
        value = given[slot.name]
        std = weight**-0.5 if weight > 0.0 else least * abs(value)
        by_records = flight[slot.name]  # with a term, the slope at the trim may be what the file states
        extended = fit[slot.name] + by_records.nearest(value).value - by_records.value
        found.append(
            ChangedValue(
                parameter=slot.name,
                unit=units.get(slot.name, names.get(slot.name, "")),
                given=value,
                extended=extended,
                stated_std=std,
                identifiable=flight[slot.name].determined,
                effect=_effect(fit, i, fit[slot.name] - value),
            )
        )
    return tuple(sorted(found, key=lambda one: -max(one.effect.values(), default=0.0)))


def _effect(fit: FlightFit, slot: int, change: float) -> dict[str, float]:
    """Channel -> r.m.s. change of the predicted readings by a change of one value, in units of their noise."""
    columns = fit.columns[..., slot]
    sizes = np.sqrt(np.mean(np.where(fit.seen, columns, 0.0) ** 2, axis=(0, 1))) * abs(change)
    return {name: float(size) for name, size in zip(fit.model.outputs, sizes, strict=True)}


def determined_pairs(
    fit: FlightFit, changed: Sequence[ChangedValue], given: Mapping[str, float], criteria: PartCriteria
) -> tuple[Combination, ...]:
    """Combinations of two values that the records determine, where they determine neither of the two.

    Values count in units of their stated uncertainty. A combination is the direction of smallest variance of a pair. It
    is reported if the records determine it much better than either value, and if the change of the value shows on a
    reading.
    """
    index = {slot.name: i for i, slot in enumerate(fit.slots)}
    stated = {one.parameter: one.stated_std for one in changed if one.stated_std > 0.0}
    covariance = _of_stated(fit, stated)
    unsure = 1.0 - fit.criteria.parts.half
    found: dict[tuple[str, str], Combination] = {}
    for one in changed:
        if one.parameter not in stated or max(one.effect.values(), default=0.0) <= 1.0:
            continue
        pairs = []
        for name in stated.keys() - {one.parameter}:
            at = [index[one.parameter], index[name]]
            variance, directions = np.linalg.eigh(covariance[np.ix_(at, at)])
            if variance[1] > unsure and variance[0] < unsure * np.diagonal(covariance)[at].min():
                pairs.append((float(variance[0]), name, directions[:, 0]))
        variance, name, along = min(pairs, key=lambda pair: pair[:2], default=(np.inf, "", np.zeros(2)))
        key = (min(one.parameter, name), max(one.parameter, name))
        if key not in found and variance < unsure:
            both = np.array([stated[one.parameter], stated[name]])
            std = math.sqrt(variance)
            found[key] = _combined(one, (name, given[name], fit[name]), along, both, std, criteria.slightly)
    return tuple(found.values())


def _of_stated(fit: FlightFit, stated: Mapping[str, float]) -> np.ndarray:
    """(slots, slots) Covariance of the values by the records and their stated uncertainties, in units of the latter."""
    unit = np.array([stated.get(slot.name, 1.0) for slot in fit.slots])
    gram = fit.grams.sum(axis=0) * unit[:, None] * unit
    return scaled_inverse(gram + np.diag([float(slot.name in stated) for slot in fit.slots]))


def _combined(
    one: ChangedValue, other: tuple[str, float, float], along: np.ndarray, stated: np.ndarray, std: float, worse: float
) -> Combination:
    """The combination of two values in words: their ratio or product if both count alike, else a weighted sum.

    `other` is a name with its value as given and in the extended model; powers that differ by less than the factor
    `worse` count as alike.
    """
    name, was, now = other
    given = np.array([one.given, was])
    extended = np.array([one.extended, now])
    powers = along / stated * extended  # of relative changes, where the records determine the direction
    unlike = np.abs(powers).max() / max(np.abs(powers).min(), 1e-300)
    if unlike < worse and (extended * given > 0.0).all():
        sign = 1.0 if powers[0] * powers[1] > 0.0 else -1.0
        ratio = (extended[0] / given[0]) * (extended[1] / given[1]) ** sign
        what = f"{one.parameter} {'*' if sign > 0.0 else '/'} {name}"
        told = f"{what}: {with_deviation(ratio, ratio * std / abs(powers[0]))} times the value as given"
    else:
        weight = (along[1] / stated[1]) / (along[0] / stated[0])
        before = given[0] + weight * given[1]
        after = extended[0] + weight * extended[1]
        what = f"{one.parameter} {'+' if weight > 0.0 else '-'} {digits(abs(weight))} {name}"
        by_records = with_deviation(after, std * stated[0] / abs(along[0]))
        told = f"{what}: {digits(before)} as given, {by_records} by the records"
    sentence = f"{one.parameter} and {name} cannot be told apart; the records determine {told}."
    return Combination(parameters=(one.parameter, name), sentence=sentence)


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of the file or model, in `unit`: for an aircraft a derivative, term or effect."""

    name: str
    unit: str
    a_priori: float  # its value as given; 0 if there is none
    refitted: float  # its estimate with the structure as given
    extended: float  # its estimate in the extended model
    cramer_rao: tuple[float, float]  # standard deviations of both if the structure were exact and the noise white
    flight: FlightValue  # its value according to the records alone, with a corrected standard deviation

    def to_dict(self) -> dict[str, Any]:
        return {
            "unit": self.unit,
            "a_priori": self.a_priori,
            "refitted": {"value": self.refitted, "std_cramer_rao": self.cramer_rao[0]},
            "extended": {
                "value": self.extended,
                "std": self.flight.fitted_std,
                "std_cramer_rao": self.cramer_rao[1],
            },
            "flight": {"value": self.flight.value, "std": self.flight.std, "told": self.flight.determined},
        }
