"""Tables and bars of a comparison of two diagnoses, or of many flights."""

from __future__ import annotations

import math
from collections.abc import Sequence

from casid.acceptance.compared import ComparedValue, Comparison, flight_pair, named, value_pair
from casid.acceptance.fleet import Fleet
from casid.report.sections import Bars, ReportTable, of_rows, where
from casid.report.words import digits, pretty


def bars_of_diagnoses(found: Comparison) -> Bars:
    """Return the errors as given of every channel, one diagnosis below the other."""
    rows = [(named(one.name), one.as_given) for one in (found.together, *found.channels)]
    return _bars("Error of the simulation as given on held-out records, times the noise", found.names, rows)


def bars_of_flights(found: Fleet) -> Bars:
    """Return the errors as given of every record."""
    rows = [(one.record, (one.error,)) for one in found.flights]
    return _bars("Error of the simulation as given, all channels, times the noise", ("as given",), rows)


def _bars(caption: str, names: Sequence[str], rows: Sequence[tuple[str, Sequence[float]]]) -> Bars:
    """Lay values out on one logarithmic scale from half of the noise; what diverges fills its row."""
    finite = [value for _, values in rows for value in values if math.isfinite(value) and value > 0.0]
    low = math.log(0.5)
    high = math.log(max([2.0, *finite]))

    def width(value: float) -> float:
        share = (math.log(max(value, 0.5)) - low) / (high - low)
        return 0.0 if math.isnan(value) else 100.0 * min(max(share, 0.01), 1.0)

    drawn = [(name, [(_error(value), width(value)) for value in values]) for name, values in rows]
    return Bars(caption=caption, names=names, rows=drawn)


def tables_of_diagnoses(found: Comparison) -> list[ReportTable]:
    """Return causes, values and errors of the two, what differs first."""
    first, second = found.names
    causes = ReportTable(
        head=("cause", first, second),
        rows=[(one.name, *(pretty(size) or "not named" for size in one.sizes)) for one in found.causes],
        marked=where("" in one.sizes for one in found.causes),
        caption="Causes that were named, with size and probability",
    )
    differing = [one for one in found.values if one.differs]
    values = ReportTable(
        head=("parameter", "as given", "by the records"),
        rows=list(map(_value, differing)),
        marked=where(one.sigmas > 3.0 for one in differing),
        caption="Values that were changed in the file, or of which the records say something else: more than three "
        "standard deviations apart",
    )
    errors = of_rows(found.rows(), "Errors by channel on the held-out records, those that changed most first")
    by_record = found.rows_of("record", found.records)
    return [causes, values, errors, of_rows(by_record, "Errors by record, all channels together")]


def table_of_flights(found: Fleet) -> ReportTable:
    """Return a row for each flight."""
    rows = [
        {
            "record": one.record,
            "length [s]": f"{one.duration:.0f}",
            "error / noise": _error(one.error),
            "worst channel": f"{named(one.worst)} {_error(one.errors[one.worst])}" if one.worst else one.diverged,
            "estimate": one.verdict,
            "what differs": pretty("\n".join([*one.faults, *map(str, one.changes)])) or "–",
        }
        for one in found.flights
    ]
    told = "Flown as given, times the noise; estimated from the record alone; and what differs from the other flights"
    return ReportTable.of(rows, told, marked=where(one.faults or one.changes or one.diverged for one in found.flights))


def _value(one: ComparedValue) -> tuple[str, str, str]:
    return one.name, pretty(value_pair(one.given).replace("->", "→")), pretty(flight_pair(one).replace("->", "→"))


def _error(value: float) -> str:
    return "diverges" if math.isinf(value) else digits(value, 2)
