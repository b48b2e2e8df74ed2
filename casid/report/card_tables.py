"""The tables of a flight card, for a page and for a terminal."""

from __future__ import annotations

import math
from textwrap import indent

from casid.acceptance.compared import named
from casid.design.flight_card import Expected, FlightCard
from casid.report.sections import ReportTable, where
from casid.report.words import digits, pretty

_NOTHING = 0.005  # of the larger end of a range


def card_tables(card: FlightCard) -> list[ReportTable]:
    """Return the trim, the movements with their times, and the expected motion with its limits."""
    return [table for table in (_trim(card), _movements(card), _expected(card)) if table.rows]


def card_in_words(card: FlightCard) -> str:
    """Return the card as text, a line per row."""
    return "\n\n".join(f"{table.caption}\n{indent(table.text(), '  ')}" for table in card_tables(card))


def _named(card: FlightCard, name: str) -> str:
    unit = pretty(card.units[name])
    return f"{named(name)} [{unit}]" if unit and unit != "1" else named(name)


def _trim(card: FlightCard) -> ReportTable:
    rows = [{"before": _named(card, name), "value": digits(value)} for name, value in card.trim.items()]
    return ReportTable.of(rows, "Trimmed level flight, held for 5 s", numeric=True)


def _movements(card: FlightCard) -> ReportTable:
    def change(value: float) -> str:
        return f"{round(value, 1) + 0.0:+.1f}".replace("-", "−")

    rows = [
        {"from t [s]": f"{one.t:.2f}", **{_named(card, name): change(one.change[name]) for name in card.inputs}}
        for one in card.movements
    ]
    told = f"Move, as changes from trim, each held until the next line; the end is at {card.duration:.1f} s"
    return ReportTable.of(rows, told, numeric=True)


def _expected(card: FlightCard) -> ReportTable:
    rows = [
        {
            "channel": _named(card, one.channel),
            "expected": f"{_short(one.least, one)} to {_short(one.most, one)}",
            "limit": f"±{digits(one.limit, 2)}" if math.isfinite(one.limit) else "–",
        }
        for one in card.expected
    ]
    limited = where(math.isfinite(one.limit) for one in card.expected)
    told = "What to expect, as changes from trim; end the manoeuvre beyond the limit"
    return ReportTable.of(rows, told, numeric=True, marked=limited)


def _short(value: float, of: Expected) -> str:
    """Return an end of a range; 0 for what is nothing beside the other end."""
    return "0" if abs(value) < _NOTHING * max(-of.least, of.most) else digits(value, 2)
