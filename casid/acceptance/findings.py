"""List what an extended aircraft has that the given one lacks, and make the extended aircraft without each of these."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.model.numbers import digits, with_deviation
from casid.model.terms import derivative_term
from casid.model.vocabulary import effect_title

_VISIBLE = 1e-3  # of the largest derivative of a row, from which one that was zero is told
_LENGTHS = ("moment_length_lateral", "moment_length_pitch", "rate_length_lateral", "rate_length_pitch")
_PLACES = ("thrust_line_z", "engine_y", "accelerometer", "alpha_vane", "beta_vane")
_BODY = ("mass", "inertia", "gravity", "area", *_LENGTHS, *_PLACES)


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundPart:
    """A part of an extended aircraft: how it is called, and the aircraft `without` it, all else as extended.

    `subject`: the name of its cause, `actuator_lag(delta_e)`; "": it is numbers. `changes`: these in words.
    """

    title: str
    without: Aircraft
    subject: str = ""
    changes: tuple[str, ...] = ()


def found_parts(given: Aircraft, extended: Aircraft) -> tuple[FoundPart, ...]:
    """Each effect of the extended aircraft that the given one lacks, and what it has otherwise: the numbers of each
    coefficient, and of the body."""
    return (*_effects(given, extended), *_rows(given, extended), *_bodies(given, extended))


def _effects(given: Aircraft, extended: Aircraft) -> Iterator[FoundPart]:
    """One that the given aircraft has with another size goes back to that."""
    own = {(one.kind, one.target, one.term): one for one in given.effects}
    for i, effect in enumerate(extended.effects):
        if effect not in given.effects:
            before = own.get((effect.kind, effect.target, effect.term))
            effects = (*extended.effects[:i], *([before] if before else []), *extended.effects[i + 1 :])
            yield FoundPart(
                title=effect_title(effect.kind, effect.target, effect.term),
                without=replace(extended, effects=effects),
                subject=effect_of(effect).name,
                changes=(_size(effect),),
            )


def _rows(given: Aircraft, extended: Aircraft) -> Iterator[FoundPart]:
    if given.force_axes != extended.force_axes:
        return
    for coefficient in extended.coefficients:
        own = _row(given, coefficient)
        if own == _row(extended, coefficient):
            continue
        derivatives = {n: v for n, v in extended.derivatives.items() if derivative_term(n)[0] != coefficient}
        terms = {c: dict(row) for c, row in extended.terms.items() if c != coefficient}
        if own[1]:
            terms[coefficient] = dict(own[1])
        tables = (*(one for one in extended.tables if one.coefficient != coefficient), *own[2])
        without = replace(extended, derivatives=derivatives | own[0], terms=terms, tables=tables)
        changes = _changes(own[0], _row(extended, coefficient)[0])
        yield FoundPart(title=f"numbers of {coefficient}", without=without, changes=changes)


def _size(effect: EffectValue) -> str:
    """Write the size of an effect in SI units, with its deviation where the file has one."""
    value = digits(effect.value, 3) if effect.std is None else with_deviation(effect.value, effect.std)
    return f"{value} {effect.unit}".strip() if effect.unit != "1" else value


def _changes(before: dict[str, float], after: dict[str, float]) -> tuple[str, ...]:
    """Write how derivatives changed, the largest change first."""
    changed = [(n, before.get(n, 0.0), after.get(n, 0.0)) for n in {**before, **after}]
    least = _VISIBLE * max((abs(new) for _, _, new in changed), default=0.0)
    changed = [one for one in changed if abs(one[2] - one[1]) > (least if one[1] == 0.0 else 0.0)]
    changed.sort(key=lambda one: -abs(one[2] - one[1]) / max(abs(one[1]), 1e-12))
    return tuple(
        f"{name} from {digits(old)} to {digits(new)}" + (f" ({100.0 * (new / old - 1.0):+.0f} %)" if old else "")
        for name, old, new in changed
    )


def _row(aircraft: Aircraft, coefficient: str) -> tuple[dict[str, float], dict[str, float], tuple]:
    derivatives = {n: v for n, v in aircraft.derivatives.items() if derivative_term(n)[0] == coefficient}
    tables = tuple(one for one in aircraft.tables if one.coefficient == coefficient)
    return derivatives, dict(aircraft.terms.get(coefficient, {})), tables


def _bodies(given: Aircraft, extended: Aircraft) -> Iterator[FoundPart]:
    for name in _BODY:
        own = getattr(given, name)
        if own != getattr(extended, name):
            yield FoundPart(title=name.replace("_", " "), without=replace(extended, **{name: own}))
