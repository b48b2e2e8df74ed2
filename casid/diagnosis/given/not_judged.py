"""What the records or the file leave open. It is reported with every verdict, above all with "adequate"."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.given.flight_values import FlightValue
from casid.diagnosis.kinematics.kinematics import NEEDED
from casid.model.aircraft import Aircraft
from casid.model.vocabulary import effect_title
from casid.records.record import Record

# what a person looks for: angular accelerations and altitude are extras
_EXPECTED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "full": ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az"),
        "longitudinal": ("V", "alpha", "q", "theta", "ax", "az"),
        "lateral": ("beta", "p", "r", "phi", "psi", "ay"),
    }
)
_WIND: Mapping[str, str] = MappingProxyType({"V": "x", "alpha": "z", "beta": "y"})


@dataclass(frozen=True, kw_only=True)
class NotJudged:
    """Something that was not judged, `what`, and `because` of which missing channel, surface or excitation."""

    what: str
    because: str

    def to_dict(self) -> dict[str, Any]:
        """One entry of `not_judged` in diagnosis.json."""
        return {"what": self.what, "because": self.because}


def left_open(flight: Flight, given: Sequence[Record], values: Mapping[str, FlightValue]) -> Iterator[NotJudged]:
    """What stays open in the axes of a flight: instruments, moving air, and numbers of the file.

    given    the records as they were read
    values   what flight says of every number of the file
    """
    absent = [name for name in _EXPECTED[flight.axes] if not any(name in record for record in given)]
    constant = [name for name in _EXPECTED[flight.axes] if name not in (*flight.outputs, *absent)]
    for names, because in ((absent, f"no channel {_all_of(absent)}"), (constant, f"{_all_of(constant)} does not move")):
        if names:
            air = "".join(f", moving air along {_WIND[name]}" for name in names if name in _WIND)
            yield NotJudged(what=f"the instruments of {_all_of(names)}{air}", because=because)
    needed = [name for name in NEEDED[flight.axes] if name not in flight.outputs]
    if needed:
        yield NotJudged(what="instruments by kinematics alone", because=f"they take {_all_of(needed)} too")
    for surface in flight.resting:
        if any(surface in record for record in given):
            yield NotJudged(what=f"derivatives by {surface}", because=f"{surface} stands still")
    undetermined = [name for name in flight.aircraft.derivatives if name in values and not values[name].determined]
    if undetermined:
        yield NotJudged(
            what=", ".join(undetermined),
            because="not identifiable: these records determine them less well than the file",
        )


def out_of_sight(flight: Flight, detectable: Mapping[str, float]) -> Iterator[NotJudged]:
    """What the fitted records cannot show: instrument and thrust faults whose smallest `detectable` size exceeds the
    largest plausible one, and channels whose noise could not be measured.
    """
    beyond = [
        effect_title(*effect.key)
        for effect in flight.effects
        if (effect.of_an_instrument or effect.station == "surface") and detectable.get(effect.name, 0.0) > effect.limit
    ]
    if beyond:
        yield NotJudged(what=_all_of(beyond), because="not identifiable: the derivatives absorb any plausible size")
    if flight.noise_by_fit:
        because = "their noise cannot be measured, so their residuals count as noise"
        yield NotJudged(what=f"anything smaller than the residuals of {_all_of(flight.doubted)}", because=because)


def of_other_records(aircraft: Aircraft, records: Sequence[str]) -> Iterator[NotJudged]:
    """Effects of a file that belong to records of other names than these."""
    for effect in aircraft.effects:
        named = effect.records or tuple(effect.onset_s or ())
        if named and not set(named) & set(records):
            title = f"{effect.kind}({effect.target}) of the file" if effect.target else f"{effect.kind} of the file"
            yield NotJudged(what=title, because=f"it belongs to {_all_of(named)}, and no record has this name")


def _all_of(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
