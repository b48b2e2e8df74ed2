"""What is read off the posterior: causes with their sizes, what is minor, what stays unexplained, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit, ndtr

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.evidence import Evidence, deviation, is_sure, jackknife, weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_at, missing_oscillation
from casid.diagnosis.explanations.columns import TURBULENCE
from casid.diagnosis.explanations.posterior import Belief
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.refit import Explained
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.verdict import onset_intervals
from casid.diagnosis.naming.size import meaningful_share, missing_share
from casid.model.vocabulary import effect_sentence


@dataclass(frozen=True, eq=False, kw_only=True)
class PosteriorReading:
    """What a posterior says in words. `structure` was put into the model beforehand and did not compete."""

    explained: Explained
    structure: tuple[Attached, ...]

    @property
    def priors(self) -> Priors:
        return self.explained.lead.fit.criteria.priors

    @cached_property
    def named(self) -> tuple[Belief, ...]:
        return self.explained.posterior.named

    @cached_property
    def fit(self) -> FlightFit:
        """The model with the named causes and no others that competed, by its own noise."""
        lead = self.explained.lead
        own = {one.name: one for one in lead.fit.attached if one.name in lead.own}
        wanted = {one.name for one in self.named}
        if wanted == own.keys():
            return relaxed(lead.fit)
        others = [one for one in lead.fit.attached if one.name not in lead.own]
        chosen = [own.get(one.name) or _sized(self.explained.stands_for(one.column), one) for one in self.named]
        return relaxed(fit(lead.fit.flight, [*others, *chosen], lead.fit.noise, lead.fit, iterations=12))

    @cached_property
    def evidence(self) -> Evidence:
        return weigh(self.fit)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """The named ones, strongest first, and structure that is large."""
        found = [self._cause(one) for one in self.named if self._still(one)]
        found += [self._put_in(one) for one in self._standing if self._notable(one) >= self.priors.named]
        return tuple(sorted(found, key=lambda c: -(c.log_odds or 0.0)))

    @cached_property
    def minor(self) -> tuple[Cause, ...]:
        """What is probably there and not of a size that matters, and structure that was put in."""
        nuisance = [replace(self._cause(one), meaningful=False) for one in self.named if not self._still(one)]
        stood_for = {name for one in self.named for name in (one.name, *(other for other, _ in one.alike))}
        there = {one.name for one in self.fit.attached}
        beliefs = [b for b in self.explained.posterior.causes if b.probability > 0.5 and b.name not in stood_for]
        found = [self._put_in(one) for one in self._standing if self._notable(one) < self.priors.named]
        return (*nuisance, *(self._predicted(b) for b in beliefs if b.name not in there), *found)

    def _still(self, belief: Belief) -> bool:
        """Whether the size of a named cause matters, as likely as a name needs, also where the fit has ended."""
        one = next(a for a in self.fit.attached if a.name == belief.name)
        if one.name not in {slot.name for slot in self.fit.slots}:
            return True
        return self._larger(one, 1.0) >= self.priors.named

    def _larger(self, one: Attached, least: float) -> float:
        """Probability that a fitted effect is larger than so many times what matters."""
        share, std = meaningful_share(self.fit, one), deviation(self.evidence, one.name)
        value = abs(one.values["value"])
        return float(ndtr((share - least) / max(share * std / max(value, 1e-300), 1e-12)))

    @property
    def _standing(self) -> list[Attached]:
        names = {one.name for one in self.structure}
        return [one for one in self.fit.attached if one.name in names]

    def _notable(self, one: Attached) -> float:
        """Probability that structure which is expected of any aircraft is large enough to be told as a cause."""
        if one.nuisance or not is_sure(self.evidence, one.name):
            return 0.0
        return self._larger(one, self.priors.expected)

    def _cause(self, belief: Belief) -> Cause:
        one = next(a for a in self.fit.attached if a.name == belief.name)
        slots = {slot.name for slot in self.fit.slots}
        std = self._std(one) if one.name in slots else belief.std
        intervals = self.explained.lead.intervals.get(one.name, {})
        stated = _cause_of(one, self.fit, belief, max(std, belief.std if one.effect.linear else 0.0))
        onsets = {r: intervals.get(r, (t - 1.0, t + 1.0)) for r, t in one.onsets.items()}
        return replace(
            stated,
            onset_s=onset_intervals(self.evidence, one, onsets) if one.effect.timed else None,
            indistinguishable_from=tuple(self._alike(name, p) for name, p in belief.alike),
        )

    def _std(self, one: Attached) -> float:
        """1-sigma of a size: of the fit and its stretches of record, or by leaving out records, if that is more."""
        there = [r for r, name in enumerate(self.fit.batch.names) if one.concerns(name)]
        return max(deviation(self.evidence, one.name), jackknife(self.evidence, one.name, there))

    def _alike(self, name: str, probability: float) -> Mapping[str, object]:
        belief = next(b for b in self.explained.posterior.causes if b.name == name)
        effect = self.explained.stands_for(belief.column).effect
        return {
            "kind": effect.kind,
            "target": effect.target,
            "term": effect.term,
            "value": belief.size,
            "unit": effect.unit,
            "probability": self.priors.tempered(probability),
        }

    def _predicted(self, belief: Belief) -> Cause:
        one = _sized(self.explained.stands_for(belief.column), belief)
        stated = _cause_of(one, self.explained.lead.fit, belief, belief.std)
        onsets = {record: (t - 1.0, t + 1.0) for record, t in one.onsets.items()}
        sentence = f"Not sure, or too small to matter: {stated.sentence}"
        return replace(stated, meaningful=False, onset_s=onsets or None, sentence=sentence)

    def _put_in(self, one: Attached) -> Cause:
        std = deviation(self.evidence, one.name)
        value, log_odds = one.values["value"], 0.5 * (one.values["value"] / std) ** 2
        there = Belief(
            name=one.name,
            kind=one.effect.kind,
            probability=1.0,
            matters=self._notable(one),
            log_odds=log_odds,
            size=value,
            std=std,
            column=self.explained.lead.columns.innovations.causes[0],
            alike=(),
            together=self._notable(one),
        )
        stated = _cause_of(one, self.fit, there, std)
        if there.matters >= self.priors.named:
            return replace(stated, probability=self.priors.tempered(there.matters))
        return replace(stated, meaningful=False, sentence=f"Expected of any aircraft, and added: {stated.sentence}")

    @cached_property
    def unexplained(self) -> tuple[tuple[MissingInput, float], ...]:
        """Where something enters that no cause explains, of a size that matters, and with which probability."""
        found = []
        for name, p in self.explained.posterior.unknown.items():
            if p > 0.5:
                station = "wind_z" if name == TURBULENCE else name
                found += [(one, p) for one in missing_at(self.evidence, [station])]
        records, samples = len(self.fit.batch.names), self.fit.readings
        for one in missing_oscillation(self.evidence)[:1]:
            odds = 0.5 * one.gain - records * float(np.log(samples)) + self.priors.unknown(len(found) + 1)
            if missing_share(self.fit, one) > self.fit.criteria.size.share and odds > 0.0:
                found.append((one, float(expit(odds))))
        return tuple(sorted(((one, self.priors.tempered(p)) for one, p in found), key=lambda pair: -pair[0].gain))

    @property
    def explanations(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        """What the most probable explanations name, and their probabilities."""
        of = self.explained.posterior.explanations
        stated = list(of.items())[: self.priors.numerics.reported]
        return tuple((tuple(sorted(names)), self.priors.tempered(p)) for names, p in stated)

    @property
    def believed(self) -> dict[str, float]:
        """Probability of every cause that may be there at a size that matters."""
        put_in = {one.name: self._notable(one) for one in self._standing}
        found = {one.name: one.matters for one in self.explained.posterior.causes} | put_in
        return {name: self.priors.tempered(min(p, 1.0)) for name, p in found.items() if p > self.priors.numerics.least}

    def verdict(self, causes: Sequence[Cause]) -> tuple[str, str]:
        """(verdict, the sentence that opens the report)."""
        stated = " ".join(cause.statement for cause in causes)
        if self.unexplained:
            where, p = self.unexplained[0][0].place.words, self.unexplained[0][1]
            if causes:
                return (
                    "partly explained",
                    f"{stated} Something more is missing: it enters at {where} ({100 * p:.0f} %).",
                )
            sentence = f"The simulation misses something that no cause in the catalogue explains; it enters at {where}"
            return "unexplained", f"{sentence} ({100 * p:.0f} %)."
        if causes:
            return "explained", stated
        p = self.explained.posterior.adequate
        sentence = f"The model is adequate: with {100 * p:.0f} % nothing of a size that matters is wrong with it"
        return "adequate", f"{sentence} in these records.{self._hint()}"

    def _hint(self) -> str:
        likely = [one for one in self.explained.posterior.causes if one.matters > 0.2]
        if not likely:
            return ""
        return (
            f" Not probable enough to be named: {', '.join(f'{b.name} ({100 * b.matters:.0f} %)' for b in likely[:3])}."
        )


def _sized(one: Attached, belief: Belief) -> Attached:
    if one.name != belief.name or one.effect.members:
        return one
    return one.with_values({"value": belief.size})


def _cause_of(one: Attached, base: FlightFit, belief: Belief, std: float) -> Cause:
    effect, values = one.effect, one.effect.in_words(one.values)
    value = values["value"]
    statistic = 2.0 * belief.log_odds
    sentence = effect_sentence(effect.kind, effect.target, effect.term, value)
    if effect.timed:
        sentence = sentence[:-1] + ": " + ", ".join(f"{r} from t = {t:.1f} s" for r, t in one.onsets.items()) + "."
    elif one.records and len(one.records) < len(base.batch.names):
        sentence = f"{sentence[:-1]}, in {', '.join(one.records)} only."
    return Cause(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=value,
        std=std,
        unit=effect.unit,
        records=tuple(one.onsets) if effect.timed else one.records or base.batch.names,
        onset_s=None,
        statistic=statistic,
        dof=len(values),
        held_out_gain=None,
        indistinguishable_from=(),
        sentence=sentence,
        parameters={k: v for k, v in values.items() if k != "value" and v != effect.defaults.get(k)},
        meaningful=True,
        share=meaningful_share(base, one),
        probability=base.criteria.priors.tempered(belief.probability),
        log_odds=belief.log_odds,
    )
