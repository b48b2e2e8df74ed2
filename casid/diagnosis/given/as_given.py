"""The aircraft file as it is given, flown through the records: its own values, its own effects, nothing fitted.

Only where a flight begins is not in the file: the initial state is the one that fits the first seconds of each record
best. A fit over the whole record would bend it to make up for what is wrong with the file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.view import View, view_of
from casid.errors import InputError
from casid.native.processors import side_by_side
from casid.records.record import Record

WINDOW_S = 5.0  # at the beginning of a record, to which its initial state is fitted
_ITERATIONS, _TOLERANCE = 6, 1.0


def fly_as_given(flight: Flight, held: Sequence[Record], known: Sequence[Attached]) -> tuple[View, View]:
    """The unmodified file in the records of a flight, and in those that are held out; `known` are its own effects."""
    both = [flight, flight.with_records(flight.aircraft, held)]
    fitted, unseen = side_by_side(lambda one: _flown(one, known), both)
    return fitted, unseen


def _flown(flight: Flight, known: Sequence[Attached]) -> View:
    states = fit(flight, known, flight.noise(), free="states", iterations=_ITERATIONS, tolerance=_TOLERANCE)
    return view_of(states, _start(flight, known))


def _start(flight: Flight, known: Sequence[Attached]) -> np.ndarray | None:
    """(R, states) that fit the first `WINDOW_S` of the records best; None where these show too little."""
    parts = [record.between(record.t[0], record.t[0] + WINDOW_S) for record in flight.records]
    try:
        short = flight.with_records(flight.aircraft, parts)
        begun = fit(short, known, short.noise(), free="states", iterations=_ITERATIONS, tolerance=_TOLERANCE)
    except InputError:
        return None
    return begun.linear.X[0]
