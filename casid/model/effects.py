"""The catalogue of effects that make sense for an aircraft and its instruments."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Protocol

from casid.errors import InputError, unknown
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import group_channels
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.vocabulary import KINDS, check_effect
from casid.signals import SURFACES

_OF_A_WING = ("surface", "coefficients", "moments")  # stations that an aircraft without a wing does not have


def catalogue(aircraft: Aircraft, outputs: Iterable[str]) -> list[Effect]:
    """Every deterministic effect that makes sense for this aircraft and these measured outputs."""
    measured = frozenset(outputs)
    kinds = [kind for kind in KINDS.values() if aircraft.winged or not kind.of_coefficients]
    shown = [e for kind in kinds for e in kind.candidates(aircraft) if _shows_in(e, measured)]
    if not aircraft.winged:
        shown = [e for e in shown if e.station not in _OF_A_WING and e.target not in (*SURFACES, "surfaces", "thrust")]
        shown = [e for e in shown if e.size.amplitude is None]  # no surface drives an oscillation
    alone: dict[object, Effect] = {}
    for effect in shown:  # a fault of a group may be, in these outputs, that of one channel, or of a group before it
        there = tuple(sorted(channel for channel in group_channels(effect.target) if channel in measured))
        alone.setdefault((effect.kind, effect.term, there) if there else effect.name, effect)
    return list(alone.values())


def _shows_in(effect: Effect, measured: Collection[str]) -> bool:
    seen = not effect.reads or any(channel in measured for channel in effect.reads)
    return seen and effect.traits.covered_by not in measured and not effect.stochastic


class Named(Protocol):
    """Name of an effect: an `EffectValue` of an aircraft file, or a cause of a diagnosis."""

    @property
    def kind(self) -> str: ...
    @property
    def target(self) -> str: ...
    @property
    def term(self) -> str | None: ...
    @property
    def parameters(self) -> Mapping[str, float]: ...


def effect_of(value: Named) -> Effect:
    """The Effect that an `[[effects]]` entry of an aircraft file, or a cause, refers to."""
    kind = KINDS[value.kind]
    make = next((make for name, make in kind.variants.items() if name in value.parameters), kind.make)
    return make(value.target or "", value.term) if value.term else make(value.target or "")


_NAME = re.compile(r"(?P<kind>\w+)(?:\((?P<target>[^:,()]*)(?::(?P<term>[^,()]*))?(?:, (?P<variant>[^()]*))?\))?")


def effect_named(name: str) -> Effect:
    """The Effect of a name in tables, "actuator_lag(delta_e)", "aero_term(Cm:alpha^2)"; InputError for none."""
    parts = _NAME.fullmatch(name.strip())
    if parts is None:
        raise InputError(f"effect '{name}': expected kind(target) or kind(target:term), like actuator_lag(delta_e)")
    kind = parts["kind"]
    target = parts["target"] or ""
    term = parts["term"]
    check_effect(kind, target, term)
    made = KINDS[kind].effects_at(target, term)
    wanted = parts["variant"] or ""
    for effect in made:
        if effect.variant == wanted:
            return effect
    raise unknown("variant", wanted, [effect.variant for effect in made], f"effect '{name}'")


def effect_value(text: str) -> EffectValue:
    """An effect and its size in SI from a text like "actuator_lag(delta_e)=0.1", further parameters typical ones.
    InputError for a text that is none."""
    name, _, size = text.rpartition("=")
    try:
        value = float(size)
    except ValueError:
        raise InputError(f"'{text}': expected a cause and its size in SI, like actuator_lag(delta_e)=0.1") from None
    effect = effect_named(name)
    further = {key: effect.further.typical[key] for key in effect.beside}
    return EffectValue(kind=effect.kind, target=effect.target, term=effect.term, value=value, parameters=further)
