"""The catalogue of effects that make sense for an aircraft and its instruments."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Protocol

from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.vocabulary import KINDS


def catalogue(aircraft: Aircraft, outputs: Iterable[str]) -> list[Effect]:
    """Every deterministic effect that makes sense for this aircraft and these measured outputs."""
    measured = frozenset(outputs)
    return [e for kind in KINDS.values() for e in kind.candidates(aircraft) if _shows_in(e, measured)]


def _shows_in(effect: Effect, measured: Collection[str]) -> bool:
    seen = not effect.reads or any(channel in measured for channel in effect.reads)
    return seen and effect.covered_by not in measured and not effect.stochastic


class Named(Protocol):
    """What says which effect is meant: an `EffectValue` of an aircraft file, a cause of a diagnosis."""

    @property
    def kind(self) -> str: ...
    @property
    def target(self) -> str: ...
    @property
    def term(self) -> str | None: ...
    @property
    def parameters(self) -> Mapping[str, float]: ...


def effect_of(value: Named) -> Effect:
    """The Effect that an `[[effects]]` entry of an aircraft file, or a cause, speaks of."""
    kind = KINDS[value.kind]
    make = next((make for name, make in kind.variants.items() if name in value.parameters), kind.make)
    return make(value.target or "", value.term) if value.term else make(value.target or "")
