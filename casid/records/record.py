"""A flight record: one manoeuvre, its time stamps and channels in SI units. No dynamics here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.arguments import given, listed, one_line, require, table_of
from casid.arguments import names as argument_names
from casid.errors import InputError, check_known, nearest, unknown
from casid.records.checks import TURNS, checked_fields
from casid.records.column_map import ColumnMap
from casid.records.columns import split_header
from casid.records.contents import Contents
from casid.records.series import across_gaps
from casid.records.table import RawTable
from casid.signals import CHANNELS, RADIAN_LIMITS, SURFACES, is_control, label_of, si_factor, unit_of

if TYPE_CHECKING:
    from pandas import DataFrame

_HOLDS = ("linear", "held", "cubic")
_ALSO = {"zoh": "held", "foh": "linear"}  # as control engineers call them


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """One manoeuvre.

    `from_arrays` and `from_frame` check more, and convert units.

    Attributes
    ----------
    t
        (N,) time stamps [s], strictly increasing, not necessarily uniform.
    channels
        Name -> (N,) samples in SI units; NaN marks a missing sample of a measured output.
    hold
        How inputs run between samples: "linear" (sampled continuous signal), "held" or "zoh" (output of a digital
        control law, constant over the sample interval that follows) or "cubic" (smooth signal: the spline through all
        samples). One of these for all channels, or a table of channels, {"u": "held"}; the others are then linear.
    source
        Where it came from, for messages.
    notes
        Remarks of whoever read it.
    empty
        Channels that the file names and of which it has no sample; they are left out.
    grounded
        Whether the aircraft stays on the ground: by its log, or because no airspeed of a wing is positive.
    stated
        Channel -> unit that the source states: it is believed, however large the values are.
    contents
        What was read of the file and how, and what was not and why.
    events
        Name -> times [s] of what a model declares as an event, such as a dose, {"dose": [0.0, 3.7]}: at samples or
        between them. A reading at the time of an event is one after it.

    Raises
    ------
    InputError
        For time that does not increase, channels of another length, what is no number, and degrees.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> t = 0.02 * np.arange(500)
    >>> record = cs.Record(name="m1", t=t, channels={"delta_e": 0.02 * np.sin(t), "q": 0.01 * np.cos(t)})
    >>> len(record), record["q"].shape, round(record.dt, 3)
    (500, (500,), 0.02)
    """

    name: str
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    _: KW_ONLY
    hold: str | Mapping[str, str] = "linear"
    source: str = ""
    notes: tuple[str, ...] = field(default=())
    empty: tuple[str, ...] = ()
    grounded: bool = False
    stated: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    contents: Contents = Contents()
    events: Mapping[str, Sequence[float]] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        where = f"record '{one_line(self.name, 'Record: name')}'"
        require(self.source, str, f"{where}: source", "a text in quotes")
        table_of(self.stated, f"{where}: stated", "{'alpha': 'deg'}")
        t = _samples(self.t, f"{where}: t")
        _check_increasing(t, where)
        if not isinstance(self.channels, Mapping):
            raise InputError(f"{where}: channels is {given(self.channels)}; expected a table like {{'alpha': alpha}}")
        channels = {name: _channel(name, values, t, where) for name, values in self.channels.items()}
        for key in ("notes", "empty"):
            object.__setattr__(self, key, argument_names(getattr(self, key), f"{where}: {key}"))
        object.__setattr__(self, "hold", _checked_hold(self.hold, channels, where))
        object.__setattr__(self, "events", _checked_events(self.events, t, where))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "channels", MappingProxyType(channels))
        if any(map(is_control, channels)):  # of any other system a name means what its model says
            check_radians(self, least=2.0 * np.pi)

    @classmethod
    def from_arrays(
        cls,
        name: str,
        t: np.ndarray,
        channels: Mapping[str, np.ndarray],
        *,
        units: Mapping[str, str] | None = None,
        hold: str | Mapping[str, str] = "linear",
    ) -> Record:
        """A record of arrays (N,), with every check that a file gets.

        `units` says by channel which unit it is in, "deg" or "kt"; SI where it has none. A name may carry its unit
        as a header does, "alpha [deg]". `notes` has what a person should know. A record without a control surface is
        taken as that of a system other than an aircraft: its names are the user's own, and it may be of any length.

        Parameters
        ----------
        name
            Of the record.
        t
            Times (N,) [s], increasing.
        channels
            Name -> values (N,).
        units
            Channel -> unit, like ``deg`` or ``kt``.
        hold
            How channels run between samples: ``linear``, ``held`` or ``cubic``, for all or by channel.

        Raises
        ------
        InputError
            As `read_record`.
        """
        where = f"record '{name}'"
        if not isinstance(channels, Mapping):
            raise InputError(f"{where}: channels is {given(channels)}; expected a table like {{'alpha': alpha}}")
        if "t" in channels:
            raise InputError(f"{where}: 't' is given twice, as the time and as a channel; leave one out")
        plain = Record(name=name, t=t, channels={f"_{k}": v for k, v in channels.items()})  # shapes and kinds
        columns = {"t": plain.t} | {k: plain[f"_{k}"] for k in channels}
        return _checked(name, columns, units or {}, hold)

    @classmethod
    def from_frame(
        cls,
        frame: DataFrame,
        *,
        name: str = "frame",
        units: Mapping[str, str] | None = None,
        hold: str | Mapping[str, str] = "linear",
    ) -> Record:
        """A record of a pandas data frame: its columns are the channels, `t` among them or as the name of the index.

        All else as in `from_arrays`.

        Parameters
        ----------
        frame
            Data frame of pandas.
        name
            Of the record.
        units
            Channel -> unit, like ``deg`` or ``kt``.
        hold
            As in `from_arrays`.
        """
        where = f"record '{name}'"
        if not hasattr(frame, "columns") or not hasattr(frame, "index"):
            raise InputError(f"{where}: from_frame takes a pandas DataFrame, got {given(frame)}")
        if frame.index.name is not None and split_header(str(frame.index.name))[0] == "t":
            frame = frame.reset_index()
        columns = {}
        for header in frame.columns:
            column = frame[header]
            if getattr(column, "ndim", 1) != 1:
                raise InputError(f"{where}: two columns are called '{header}'; rename or remove one")
            try:
                columns[str(header)] = column.to_numpy(dtype=float, na_value=np.nan)
            except (TypeError, ValueError):
                raise InputError(f"{where}: column '{header}' is of {column.dtype}; expected numbers") from None
        if not len(frame):
            raise InputError(f"{where}: the data frame has no rows")
        return _checked(name, columns, units or {}, hold)

    def __getitem__(self, channel: str) -> np.ndarray:
        if channel == "t":
            return self.t
        check_known("channel", (channel,), self.channels, f"record '{self.name}'")
        return self.channels[channel]

    def __contains__(self, channel: str) -> bool:
        return channel in self.channels

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        span = f"{len(self)} samples, {self.t[0]:g} to {self.t[-1]:g} s" if len(self) else "no samples"
        held = "" if self.hold == "linear" else f"; inputs {self.hold_in_words}"
        notes = f"; {len(self.notes)} notes" if self.notes else ""
        happens = f"; events {listed(self.events)}" if self.events else ""
        return f"<Record '{self.name}': {span}{held}{happens}{notes}; channels {listed(self.channels, 25)}>"

    def __getstate__(self) -> dict[str, Any]:
        # a read-only view cannot be pickled
        return {name: dict(value) if isinstance(value, Mapping) else value for name, value in self.__dict__.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        stated = state.get("stated")  # of before, a record had no events, and names alone
        state = {"events": {}} | state | {"stated": stated if isinstance(stated, Mapping) else {}}
        for array in (state["t"], *state["channels"].values()):  # which pickle does not keep
            array.flags.writeable = False
        tables = {name: MappingProxyType(dict(value)) for name, value in state.items() if isinstance(value, Mapping)}
        self.__dict__.update(state | tables)

    def hold_of(self, channel: str) -> str:
        """Return how a channel runs between samples: "linear", "held" or "cubic". Time is linear."""
        if channel == "t":
            return "linear"
        return self.hold if isinstance(self.hold, str) else self.hold.get(channel, "linear")

    @property
    def hold_in_words(self) -> str:
        """The hold as a file has it: one word, or "delta_e = held, thrust = cubic"."""
        if isinstance(self.hold, str):
            return self.hold
        return ", ".join(f"{name} = {how}" for name, how in self.hold.items())

    def following(self, names: Iterable[str]) -> np.ndarray:
        """(N-1, channels) values at the end of each sample interval: those of the next sample, or of this one where a
        channel is held."""
        names = argument_names(names, "Record.following: names")
        values = self.matrix(names)
        held = np.array([self.hold_of(name) == "held" for name in names], dtype=bool)
        return np.where(held, values[:-1], values[1:])

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time from first to last sample [s]."""
        return float(self.t[-1] - self.t[0])

    def matrix(self, names: Iterable[str]) -> np.ndarray:
        """(N, channels) of the named channels."""
        columns = [self[name] for name in argument_names(names, "Record.matrix: names")]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))

    def with_channels(self, **channels: np.ndarray) -> Record:
        """The same record with channels added or replaced, (N,) each."""
        where = f"record '{self.name}'"
        added = {name: _channel(name, values, self.t, where) for name, values in channels.items()}
        return self._with(channels={**self.channels, **added})

    def renamed(self, name: str) -> Record:
        """The same record under another name."""
        return self._with(name=require(name, str, "Record.renamed: name", "renamed('m2')"))

    def with_notes(self, *notes: str) -> Record:
        """The same record with further notes, one sentence each."""
        return self._with(notes=(*self.notes, *notes))

    def without(self, *names: str) -> Record:
        """The same record without the named channels."""
        return self._with(channels={k: v for k, v in self.channels.items() if k not in names})

    def between(self, start: float, stop: float, name: str | None = None) -> Record:
        """The part with start <= t < stop [s], time stamps kept, under its own name or another."""
        for what, value in (("start", start), ("stop", stop)):
            if not isinstance(value, Real):
                raise InputError(f"record '{self.name}': {what} is {given(value)}; expected a time in s")
        keep = (self.t >= start) & (self.t < stop)
        if not keep.any():
            raise InputError(f"record '{self.name}': no sample from {start:g} to {stop:g} s; it has {_span(self.t)}")
        channels = {k: v[keep] for k, v in self.channels.items()}
        t = self.t[keep]
        events = {k: tuple(one for one in times if t[0] <= one <= t[-1]) for k, times in self.events.items()}
        return self._with(name=name or self.name, t=t, channels=channels, events=events)

    def _with(self, **changes: Any) -> Record:
        """Another record with these fields. Its values are not judged: a motion that departs may have any."""
        other = object.__new__(Record)
        other.__setstate__({f.name: getattr(self, f.name) for f in fields(self)} | changes)
        return other


def _checked_hold(hold: Any, channels: Mapping[str, np.ndarray], where: str) -> str | Mapping[str, str]:
    """The hold in its own words, a table read-only."""
    if not isinstance(hold, Mapping):
        return _hold_word(hold, where)
    check_known("channel", hold, channels, f"{where}: hold")
    return MappingProxyType({name: _hold_word(how, f"{where}: '{name}'") for name, how in hold.items()})


def _hold_word(how: Any, where: str) -> str:
    word = _ALSO.get(how, how) if isinstance(how, str) else how
    if not isinstance(word, str) or word not in _HOLDS:
        raise unknown("hold", str(how), (*_HOLDS, *_ALSO), where)
    return word


def _checked_events(events: Any, t: np.ndarray, where: str) -> Mapping[str, tuple[float, ...]]:
    """Times of events by name, in their order, read-only."""
    if not isinstance(events, Mapping):
        raise InputError(f"{where}: events is {given(events)}; expected a table like {{'dose': [0.0, 3.7]}}")
    found = {}
    for name, times in events.items():
        what = f"{where}: times of event '{name}'"
        own = _samples(times if np.ndim(times) else [times], what)
        for one in own.tolist():
            if not (len(t) and t[0] <= one <= t[-1]):
                raise InputError(f"{what}: {one:g} s is outside the record, which has {_span(t)}")
        found[name] = tuple(sorted(own.tolist()))
    return MappingProxyType(found)


def _span(t: np.ndarray) -> str:
    return f"{t[0]:g} to {t[-1]:g} s" if len(t) else "no time at all"


def _samples(values: Any, what: str) -> np.ndarray:
    """Return (N,) floats of our own, which nobody can write to; masked ones are missing."""
    try:
        masked = np.ma.is_masked(values)
        array = None if values is None else np.ma.filled(values.astype(float), np.nan) if masked else np.asarray(values)
    except ValueError:  # rows of unlike length
        array = None
    if array is None or array.dtype.kind not in "fiu":
        is_array = isinstance(values, (np.ndarray, list, tuple))
        got = "no list of numbers alone" if is_array else given(values)
        raise InputError(f"{what} is {got}; expected numbers, an array (N,)")
    if array.ndim != 1:
        raise InputError(f"{what} has the shape {array.shape}; expected one dimension, (N,)")
    array = array.astype(float)
    array.flags.writeable = False
    return array


def _check_increasing(t: np.ndarray, where: str) -> None:
    wrong = np.flatnonzero(~np.isfinite(t))
    if len(wrong):
        raise InputError(f"{where}: t[{wrong[0]}] is {t[wrong[0]]}; every sample needs its time in s")
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        k = int(back[0])
        raise InputError(
            f"{where}: time must strictly increase, but t[{k + 1}] = {t[k + 1]:.10g} s follows t[{k}] = {t[k]:.10g} s"
        )


def _channel(name: Any, values: Any, t: np.ndarray, where: str) -> np.ndarray:
    if not isinstance(name, str):
        raise InputError(f"{where}: a channel is called {given(name)}; expected a name in quotes")
    samples = _samples(values, f"{where}: channel '{name}'")
    if samples.shape != t.shape:
        raise InputError(f"{where}: channel '{name}' has shape {samples.shape}, time {t.shape}; both need the same")
    infinite = np.flatnonzero(np.isinf(samples))
    if len(infinite):
        raise InputError(f"{where}: channel '{name}' is infinite at sample {infinite[0]}; NaN says that one is missing")
    return samples


def filled(record: Record, name: str, default: float = 0.0) -> np.ndarray:
    """A channel with missing samples interpolated; a constant where the record has none of it."""
    if name not in record or not np.isfinite(record[name]).any():
        return np.full(len(record), default)
    return across_gaps(record.t, record[name])


def check_radians(record: Record, least: float = 0.0) -> None:
    """Raise InputError for values that can only be degrees in a channel that casid knows in rad: above what an aircraft
    does, and above `least`."""
    for name, values in record.channels.items():
        limit = max(RADIAN_LIMITS.get(name, np.inf), least)
        if name in TURNS or name in record.stated:
            continue
        beyond = np.flatnonzero(np.abs(values) > limit)
        if len(beyond):
            unit = unit_of(name)
            degrees = unit_of(name).replace("rad", "deg")
            raise InputError(
                f"record '{record.name}': {name} ({label_of(name)}) is {values[beyond[0]]:.6g} {unit}, more than "
                f"{limit:.3g}; np.radians converts it, or Record.from_arrays(..., units={{'{name}': '{degrees}'}}), "
                f"where '{unit}' says that it is right; or give it another name if it is another thing"
            )


def require_channels(record: Record, channels: Iterable[str], why: str) -> None:
    """Raise InputError, naming `why` they are needed, unless the record has all the channels."""
    missing = [name for name in channels if name not in record and name != "t"]
    if not missing:
        return
    near = {name: nearest(name, record.channels) for name in missing}
    hint = "; ".join(f"is '{n}' meant to be '{name}'?" for name, n in near.items() if n and unit_of(n) == "")
    raise InputError(
        f"record '{record.name}': needs {', '.join(f'{name} ({label_of(name)})' for name in missing)} for {why}; "
        f"add the columns or map them with --map {missing[0]}=COLUMN:unit" + (f"; {hint}" if hint else "")
    )


Hold = str | Mapping[str, str]


def _checked(name: str, columns: Mapping[str, np.ndarray], units: Mapping[str, str], hold: Hold) -> Record:
    where = f"record '{name}'"
    if not isinstance(units, Mapping):
        raise InputError(f"{where}: units is {given(units)}; expected a table like {{'alpha': 'deg'}}")
    bare = {header: split_header(header) for header in columns}
    for channel, unit in units.items():
        if channel not in {n for n, _ in bare.values()}:
            raise unknown("channel", str(channel), [n for n, _ in bare.values()], f"{where}: units")
        if not isinstance(unit, str):
            raise InputError(f"{where}: units: '{channel}' is {given(unit)}; expected a unit in quotes, like 'deg'")
        if unit and channel in CHANNELS:
            si_factor(unit, channel, f"{where}: units")
    headers = [_header(*bare[header], units, where) for header in columns]
    table = RawTable(source=where, names=tuple(headers), values=np.stack(list(columns.values()), axis=1), hold=hold)
    names = [name for name, _ in bare.values()]
    # without a control surface it is no aircraft's record: names mean what the user's own model says
    own = () if any(name in SURFACES for name in names) else tuple(n for n in names if n != "t")
    record = Record(**checked_fields(table, name, ColumnMap(), own))
    familiar = [n for n in own if n in CHANNELS]
    if not familiar:
        return record
    return record.with_notes(
        f"no control surface: taken as the record of a system other than an aircraft, with {', '.join(familiar)} of "
        "its own"
    )


def _header(name: str, written: str, units: Mapping[str, str], where: str) -> str:
    """Name and unit of a column, as a file has them."""
    unit = units.get(name, written)
    if written and unit != written:
        raise InputError(f"{where}: the unit of '{name}' is [{written}] in its name and '{unit}' in units; remove one")
    return f"{name} [{unit}]" if unit else name
