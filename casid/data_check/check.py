"""Check of flight data before anything is estimated: the faults of the records, and the corrected records.

First what one channel shows alone (`records.channel_faults`), whose samples are left out; then what channels show
together, by physics that needs no aerodynamics, where alternatives to the records as given compete.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.arguments import require
from casid.data_check import words
from casid.data_check.continuity import discontinuities
from casid.data_check.criteria import DataCriteria
from casid.data_check.faults import Weighed, Weighing, described, with_readings
from casid.data_check.file_meaning import SI_OF, FileMeaning
from casid.data_check.reading import Finding, Handled
from casid.data_check.remarks import remarks
from casid.data_check.response import answers
from casid.data_check.rotors import rotor_faults
from casid.errors import InputError, check_known
from casid.frames import Rows
from casid.keeping import plain
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.plausible import Doubt, believable, doubts, impossibilities
from casid.native.threads import single_threaded
from casid.records.channel_faults import (
    ChannelFault,
    by_kind,
    channel_faults,
    not_moving,
    without_faults,
)
from casid.records.channel_ranges import ChannelRow, channel_table, gaps
from casid.records.checks import INPUTS, LONG_GAP
from casid.records.given import given_records, unflown
from casid.records.record import Record
from casid.signals import CHANNELS, SURFACES, for_a_person, unit_of


@dataclass(frozen=True, eq=False, kw_only=True)
class DataFindings:
    """Result of a check of flight data.

    Attributes
    ----------
    findings
        Faults: first signs, units and swaps of whole channels, then faulty samples, then missing channels.
    records
        The corrected records: signs, units and swaps are changed, and faulty samples are missing.
    recorded
        The records as they were given.
    table
        Range, noise and rate of every channel as given, in degrees, knots and the like.
    doubts
        Numbers of the aircraft file that are impossible, or that agree with flight only in another unit.
    impossible
        Effects of the aircraft file of an impossible size, and an inertia that no rigid body has.
    remarks
        What does not fit each other and is not explained by a fault: density and altitude, indicated airspeed, a rate
        that changes, thrust and drag, and values of the file that the motion contradicts.
    unread
        File -> reason why it could not be read; only in the command `casid check`.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.check("casid/cli/demo/m1.csv", "casid/cli/demo/aircraft.toml")
    >>> found.clean, len(found.records)
    (True, 1)
    """

    findings: tuple[Finding, ...]
    records: tuple[Record, ...]
    recorded: tuple[Record, ...]
    table: tuple[ChannelRow, ...]
    doubts: tuple[Doubt, ...] = ()
    impossible: tuple[Doubt, ...] = ()
    remarks: tuple[str, ...] = ()
    unread: Mapping[str, str] = field(default_factory=dict)

    @property
    def clean(self) -> bool:
        """Return True if nothing is wrong."""
        return not (self.findings or self.doubts or self.impossible or self.remarks or self.unread)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All that is wrong, in words."""
        file = (f"Aircraft file: {one.sentence}" for one in (*self.doubts, *self.impossible))
        unread = (f"{file} was not checked: {why}" for file, why in self.unread.items())
        return (*(one.sentence for one in self.findings), *self.remarks, *file, *unread)

    @property
    def reported(self) -> tuple[Finding, ...]:
        """Faults that could neither be corrected nor left out."""
        return tuple(one for one in self.findings if one.handled == "reported")

    def to_dict(self) -> dict[str, Any]:
        """The findings as in diagnosis.json, the channel table, and what was read of each file."""
        return {
            "records": [record.name for record in self.recorded],
            **plain(self, "data=findings remarks unread"),
            "file": plain([*self.doubts, *self.impossible]),
            "channels": {row.name: row.to_dict() for row in self.table},
            "contents": {record.name: record.contents.to_dict() for record in self.recorded},
        }

    def __str__(self) -> str:
        said = [f"- {one}" for one in self.sentences] or ["No fault of these data was found."]
        return "\n".join([*said, "", self.rows().text()])

    def rows(self) -> Rows:
        """A row for each channel of all records: its range, noise and rate, and what is suspected of it."""
        numbers = {name: ".4g" for name in ("min", "median", "max", "noise", "step", "rate Hz")}
        heads = {"channel": "", "unit": "", **numbers, "missing %": ".1f", "suspicion": ""}
        rows = []
        for one in self.table:
            kinds = [fault.kind.removeprefix("data_") for fault in self.findings if one.name in fault.target.split("+")]
            values = (one.least, one.median, one.most, one.noise, one.step, one.rate_hz)
            rows.append((one.name, one.unit, *values, 100.0 * one.missing or None, ", ".join(kinds)))
        return Rows(heads=heads, rows=rows)


@single_threaded()
@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # absurd numbers are reported below
def check(
    records: Sequence[Record | str | Path] | Record | str | Path,
    aircraft: Aircraft | str | Path | None = None,
    *,
    undo: bool | Sequence[str] = False,
    criteria: DataCriteria | None = None,
) -> DataFindings:
    """Find the faults of flight data, before anything is estimated.

    A sign, a unit or a swap is corrected when one explanation alone fits; else it is reported with its rivals. Frozen,
    held, clipped and outlying samples become missing; outliers in inputs are interpolated.

    Parameters
    ----------
    records
        Of one set of instruments, or names of files: what is in one and not in the others shows the better.
    aircraft
        Brings in weight, trim and the signs of responses to surfaces; without it these are not checked.
    undo
        True: findings are only reported, and `records` stay as they are. Names of channels: these are trusted as
        they were recorded, so that what they contradict is explained otherwise.
    criteria
        By which it decides; by default those of `DataCriteria()`.

    Returns
    -------
    DataFindings
        Print it for the findings and a table of the channels; `records` are the data as they should be.

    Raises
    ------
    InputError
        For arguments that are not records or an aircraft, and as `read_record` and `Aircraft.read`.

    Examples
    --------
    >>> import casid as cs
    >>> record = cs.read_record("casid/cli/demo/m1.csv")
    >>> cs.check(record.with_channels(q=-record["q"])).findings[0].target
    'q'
    """
    given = given_records(records, "check")
    if not given:
        raise InputError("no record was given to be checked; expected at least one")
    plane = None if aircraft is None else given_aircraft(aircraft, "check")
    believed_as_read = channels_of(undo, "check: undo")
    undo = undo is True
    if criteria is not None:
        require(criteria, DataCriteria, "check: criteria", "DataCriteria(...)")
    answered = [answers(record, plane) if plane is not None else None for record in given]
    alone = (channel_faults(record, answers=known) for record, known in zip(given, answered, strict=True))
    faults = [fault for some in alone for fault in some] + not_moving(given)
    faults = [fault for fault in faults if not {*fault.target.split("+")} & believed_as_read]
    kept = _without_empty([without_faults(record, faults) for record in given])
    cannot_be = doubts(plane) if plane is not None else ()
    believed = believable(plane, cannot_be) if plane is not None else None
    weighing = Weighing(kept, believed, criteria or DataCriteria(), believed_as_read)
    most = (criteria or DataCriteria()).most_told
    weighed = [replace(one, log_odds=min(one.log_odds, most)) for one in weighing.found()]
    together = [_of_alternative(one, len(given), undo) for one in weighed]
    samples = [_of_channel(key, found, given, undo) for key, found in by_kind(faults).items()]
    in_time = [] if "t" in believed_as_read else [*_pauses(given), *discontinuities(given)]
    missing = [*in_time, *_without_samples(given), *_no_input(given, plane)]
    corrected = tuple(with_readings(r, reading) for r, reading in zip(kept, weighing.trusted, strict=True))
    if plane is not None:
        missing += rotor_faults(corrected, plane)
    if not undo:
        kept = corrected
    return DataFindings(
        findings=(*together, *samples, *missing),
        records=given if undo else tuple(_noted(record, (*together, *samples)) for record in kept),
        recorded=given,
        table=channel_table(given),
        doubts=_of_the_file(plane, cannot_be, weighing.meanings),
        impossible=impossibilities(plane) if plane is not None else (),
        remarks=remarks(kept, None if weighing.meanings else believed, criteria or DataCriteria()),
    )


def channels_of(undo: bool | Sequence[str], where: str) -> frozenset[str]:
    """Names of the channels that are trusted as recorded; InputError, which names `where`, for any other value."""
    if isinstance(undo, bool):
        return frozenset()
    argument = where.rpartition(" ")[2]
    check_known(
        "channel",
        require(undo, (list, tuple), where, f'{argument}=True or names of channels, {argument}=["q"]'),
        CHANNELS,
        where,
    )
    return frozenset(undo)


def _of_the_file(
    aircraft: Aircraft | None, cannot_be: tuple[Doubt, ...], meanings: Sequence[FileMeaning]
) -> tuple[Doubt, ...]:
    """The most probable other meaning of the file, and what cannot be in that meaning either."""
    if aircraft is None or not meanings:
        return cannot_be
    best, *rivals = meanings
    given = getattr(aircraft, best.parameter, math.nan)
    found = Doubt(
        parameter=best.parameter,
        given=given if isinstance(given, float) else math.nan,
        unit=SI_OF.get(best.parameter, "1"),
        sentence=words.of_the_file(best.said, [one.said for one in rivals]),
    )
    return (found, *doubts(best.corrected(aircraft)))


def _without_empty(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records without the channels that have no sample in any of them."""
    held = {name for record in records for name, values in record.channels.items() if np.isfinite(values).any()}
    return tuple(record.without(*(name for name in record.channels if name not in held)) for record in records)


def _pauses(records: Sequence[Record]) -> list[Finding]:
    """Long pauses in the time of records."""
    found = []
    for record in records:
        pauses = tuple((a, b) for a, b in gaps(record) if b - a > LONG_GAP)
        if pauses:
            sentence = words.of_pauses(record.name, pauses)
            one = Finding(
                kind="data_dropout",
                target="t",
                records=(record.name,),
                intervals_s={record.name: pauses},
                handled="excluded",
                sentence=sentence,
            )
            found.append(one)
    return found


def _without_samples(records: Sequence[Record]) -> list[Finding]:
    """Channels that are named and have no sample."""
    having: dict[str, list[str]] = {}
    for record in records:
        named = (name for name, values in record.channels.items() if not np.isfinite(values).any())
        for name in (*record.empty, *named):
            having.setdefault(name, []).append(record.name)
    return [
        Finding(
            kind="data_dropout",
            target=name,
            records=tuple(names),
            handled="excluded",
            sentence=words.of_nothing(name, names, len(names) == len(records) > 1),
        )
        for name, names in having.items()
    ]


def _no_input(records: Sequence[Record], aircraft: Aircraft | None) -> list[Finding]:
    """Records on the ground or at rest, or without a surface or rotor that moves: nothing can be identified from
    them."""
    if still := {record.name: why for record in records if (why := unflown(record))}:
        said = words.of_rest(still)
        return [Finding(kind="data_stuck", target="V", records=tuple(still), handled="reported", sentence=said)]
    surfaces = [name for name in SURFACES if any(name in record for record in records)]
    rotors = aircraft.rotors.names if aircraft and aircraft.rotors else ()
    acting = (*surfaces, *rotors)
    if not surfaces or any(np.ptp(record[name]) > 0.0 for record in records for name in acting if name in record):
        return []
    sentence = words.of_no_input(surfaces, [record.name for record in records])
    target = "+".join(surfaces)
    names = tuple(record.name for record in records)
    return [Finding(kind="data_stuck", target=target, records=names, handled="reported", sentence=sentence)]


def _noted(record: Record, findings: Sequence[Finding]) -> Record:
    """The record with what was found in it among its notes."""
    said = tuple(one.sentence for one in findings if record.name in one.records)
    return replace(record, notes=(*record.notes, *said)) if said else record


def check_readings(records: Sequence[Record], names: Sequence[str]) -> tuple[tuple[Finding, ...], list[Record]]:
    """Faulty samples of the readings `names` of any system, and the records without them.

    A reading that is frozen to the end of its record stays: that an instrument is stuck is a cause like others.
    """
    faults = [fault for record in records for fault in channel_faults(record, names=names)]
    ended = [one for one in faults if one.kind != "data_steps" and not (one.kind == "data_stuck" and one.at[-1])]
    found = [_of_channel(key, some, records, False) for key, some in by_kind(ended).items()]
    return tuple(found), [without_faults(record, ended) for record in records]


def _of_channel(key: tuple[str, str], faults: Sequence[ChannelFault], records: Sequence[Record], undo: bool) -> Finding:
    kind, target = key
    t = {record.name: record.t for record in records}
    level = faults[0].value
    share = float(np.mean(np.concatenate([fault.at for fault in faults])))
    names = tuple(fault.record for fault in faults)
    factor, unit = for_a_person(unit_of(target))
    stands = f" at {factor * level:.4g} {unit if unit != '1' else ''}".rstrip() if level is not None else ""
    sentence = words.of_channel(kind, target, names, len(names) == len(records) > 1, share, stands)
    handled: Handled = "corrected" if target in INPUTS else "excluded"
    handled = "reported" if undo or kind == "data_steps" else handled
    if handled != "excluded":
        sentence = sentence.replace("are left out", "are interpolated" if handled == "corrected" else "are not trusted")
    return Finding(
        kind=kind,
        target=target,
        records=names,
        intervals_s={fault.record: tuple(fault.intervals(t[fault.record])) for fault in faults},
        value=level,
        unit=unit_of(target) if level is not None else None,
        handled=handled,
        sentence=sentence,
    )


def _of_alternative(weighed: Weighed, count: int, undo: bool) -> Finding:
    one = weighed.alternative
    handled: Handled = "corrected" if weighed.alone and not (undo or weighed.refused) else "reported"
    every = len(weighed.records) == count > 1
    rivals = [described(r) for r in weighed.rivals]
    what = one.term if one.kind == "axes" else one.unit
    sentence = words.of_alternative(one.kind, one.target, one.value, what, weighed.records, every)
    return Finding(
        kind=one.kind,
        target=one.target,
        term=one.term,
        records=weighed.records,
        value=one.value,
        unit="1" if one.value is not None else None,
        handled=handled,
        odds=math.exp(weighed.log_odds),
        sentence=sentence + words.handled_as(one.kind, one.value, rivals, undo, weighed.refused, weighed.log_odds),
        indistinguishable_from=tuple({"kind": r.kind, "target": r.target} for r in weighed.rivals),
        title=described(one),
    )
