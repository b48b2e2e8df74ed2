"""Explanations side by side: what each says, and how probable it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casid.diagnosis.result import Diagnosis
from casid.model.effects import effect_named
from casid.report.words import effect_name, probability_in_words

_TOLD = 4  # explanations told one by one


@dataclass(frozen=True, kw_only=True)
class Share:
    """What an explanation says, and its probability."""

    what: str
    probability: float

    @property
    def percent(self) -> str:
        """As it is told."""
        return probability_in_words(self.probability)


def shares(diagnosis: Diagnosis) -> list[Share]:
    """The most probable explanations and all others together; none where there are no probabilities."""
    told = [Share(what=_said(names), probability=p) for names, p in diagnosis.explanations[:_TOLD]]
    told = [one for k, one in enumerate(told) if k == 0 or one.probability >= 0.005]
    rest = 1.0 - sum(one.probability for one in told)
    return [*told, Share(what="other explanations", probability=rest)] if told and rest >= 0.005 else told


def _said(names: Sequence[str]) -> str:
    return " and ".join(title_of(name) for name in names) if names else "nothing that matters is missing"


def title_of(name: str) -> str:
    """Short name of a cause from its name in tables: "actuator_lag(delta_e)" -> "elevator: actuator lag"."""
    effect = effect_named(name)
    return f"{effect_name(effect)} ({effect.variant})" if effect.variant else effect_name(effect)
