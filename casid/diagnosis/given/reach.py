"""Scope of the records: what they can support, and what is lost because a channel or excitation is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.flight import Flight, prepare
from casid.diagnosis.given.axes import axes_that_tell
from casid.diagnosis.given.contradicted import Contradiction, contradicted
from casid.diagnosis.given.factors import Factor, common_factors
from casid.diagnosis.given.flight_values import FlightValue
from casid.diagnosis.given.not_judged import NotJudged, left_open, of_other_records
from casid.diagnosis.given.thrust import drag_level, or_thrust, with_thrust
from casid.model.aircraft import Aircraft
from casid.model.linearised import given_slopes
from casid.records.record import Record

Split = tuple[Sequence[Record], Sequence[Record]]  # fitted and held-out records


@dataclass(frozen=True, eq=False, kw_only=True)
class Reach:
    """The flight in its scope, and the held-out records prepared like it.

    given  the fitted records as they were read; `lost` what is outside the scope
    """

    flight: Flight
    held: tuple[Record, ...]
    given: tuple[Record, ...]
    lost: tuple[NotJudged, ...]

    def ready(self, recorded: Split) -> Split:
        """Records before they were corrected, prepared like these."""
        nodes = self.flight.criteria.numerics.missing_input.spacing
        fitted, held = (with_thrust(self.flight.aircraft, some, self.flight.axes, nodes).records for some in recorded)
        return fitted, held

    def not_judged(self, values: Mapping[str, FlightValue]) -> tuple[NotJudged, ...]:
        """All that stays open, with `values` as flight has them."""
        names = [record.name for record in (*self.given, *self.held)]
        return (*self.lost, *left_open(self.flight, self.given, values), *of_other_records(self.flight.aircraft, names))

    def contradicted(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> tuple[Contradiction, ...]:
        """Numbers of an aircraft file that are inconsistent with these records."""
        slopes = self._slopes(aircraft)
        found = contradicted(aircraft, self._open(aircraft, values), self.flight.criteria, slopes)
        return tuple(or_thrust(aircraft, one, self.flight.records, self.flight.criteria.data) for one in found)

    def factors(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> tuple[Factor, ...]:
        """The factors that groups of derivatives of an aircraft file have in common."""
        return common_factors(aircraft, self._open(aircraft, values), self.flight.criteria, self._slopes(aircraft))

    def _open(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> dict[str, FlightValue]:
        """The values without the level of drag where the thrust is unknown, and without drag where its history is."""
        unknown = self.flight.unknown
        closed = {drag_level(aircraft)} if "thrust" in unknown else set()
        closed |= {name for name in values if name.partition("_")[0] in unknown}
        return {name: one for name, one in values.items() if name not in closed}

    def _slopes(self, aircraft: Aircraft) -> dict[str, float]:
        return given_slopes(aircraft, self.given)


def reach_of(aircraft: Aircraft, records: Split, criteria: Criteria, axes: str | None) -> Reach:
    """The flight of (fitted, held-out) records in the axes that they support, or that were asked for.

    Raises InputError for unknown axes, and for records that cannot feed them.
    """
    fitted, held = records
    judged = axes_that_tell(fitted, axes, criteria.given, aircraft)
    nodes = criteria.numerics.missing_input.spacing
    powered = with_thrust(aircraft, fitted, judged.name, nodes)
    unseen = with_thrust(aircraft, held, judged.name, nodes).records
    flight = prepare(aircraft, powered.records, criteria, judged.name)
    flight.with_records(flight.aircraft, unseen)  # what they lack is said before the work begins
    flight = replace(flight, unknown=powered.unknown)
    return Reach(flight=flight, held=unseen, given=tuple(fitted), lost=(*judged.not_judged, *powered.lost))
