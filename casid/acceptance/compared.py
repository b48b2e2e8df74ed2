"""Two diagnoses over each other: errors by channel and by record, causes, and values."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.acceptance.justification import DIAGNOSIS, read_diagnosis
from casid.frames import Rows
from casid.keeping import plain
from casid.model.numbers import digits, with_deviation
from casid.records.limits import sound
from casid.signals import label_of

_WORSE = 1.1  # times the error of the first: the second is worse, or the first
_LISTED = 6  # names in a sentence
_SIGMAS = 3.0  # standard deviations from which two values differ


@dataclass(frozen=True, kw_only=True)
class ComparedError:
    """The error of a channel or a record in both diagnoses, over the noise; NaN where one does not have it."""

    name: str
    as_given: tuple[float, float]
    left: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class ComparedCause:
    """A cause and its size in both diagnoses, in words; empty where it was not named."""

    name: str
    sizes: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class ComparedValue:
    """A parameter as given and by the records, in both diagnoses, with the standard deviation of the latter.

    `sigmas` is the distance of the two estimates over the deviation of their difference; NaN where either has none.
    """

    name: str
    given: tuple[float, float]
    flight: tuple[float, float]
    std: tuple[float, float]

    @property
    def sigmas(self) -> float:
        spread = math.hypot(*self.std)
        return abs(self.flight[1] - self.flight[0]) / spread if spread > 0.0 else math.nan

    @property
    def differs(self) -> bool:
        """Whether the file was changed, or the records of the two say different things."""
        return self.given[0] != self.given[1] or self.sigmas > _SIGMAS


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two diagnoses, the second beside the first.

    Attributes
    ----------
    names
        Of the two folders.
    verdicts
        Of the two diagnoses.
    held_out
        Records that each judges.
    together
        The error of all channels.
    channels, records, causes, values
        Row by row, those that differ most first.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.compare_diagnoses("out/before", "out/after")  # doctest: +SKIP
    >>> found.worse, found.sentence  # doctest: +SKIP
    """

    names: tuple[str, str]
    verdicts: tuple[str, str]
    held_out: tuple[tuple[str, ...], tuple[str, ...]]
    together: ComparedError
    channels: tuple[ComparedError, ...]
    records: tuple[ComparedError, ...]
    causes: tuple[ComparedCause, ...]
    values: tuple[ComparedValue, ...]

    @property
    def worse(self) -> bool:
        """Whether the simulation as given of the second is further from flight, or has a cause that the first lacks."""
        return self._worsened or any(one.sizes[1] and not one.sizes[0] for one in self.causes)

    @property
    def _worsened(self) -> bool:
        before, after = self.together.as_given
        return not after <= _WORSE * before

    @property
    def sentence(self) -> str:
        """What changed from the first to the second."""
        before, after = self.together.as_given
        change = "is worse" if self._worsened else "is better" if before > _WORSE * after else "is as good"
        first, second = self.names
        return (
            f"The simulation as given of '{second}' {change}: {_times(after)} the noise, and {_times(before)} in "
            f"'{first}'."
        )

    @property
    def points(self) -> tuple[str, ...]:
        """What to know beside that, a sentence each."""
        second = self.names[1]
        gone = [one.name for one in self.causes if one.sizes[0] and not one.sizes[1]]
        new = [one.name for one in self.causes if one.sizes[1] and not one.sizes[0]]
        changed = [one.name for one in self.values if one.given[0] != one.given[1]]
        apart = [one.name for one in self.values if one.sigmas > _SIGMAS]
        judged = " and ".join(", ".join(some) for some in self.held_out)
        told = (
            (self.verdicts[0] != self.verdicts[1], f"Verdict: {self.verdicts[0]}, then {self.verdicts[1]}."),
            (gone, f"No longer named in {second}: {', '.join(gone)}."),
            (new, f"Named in {second} alone: {', '.join(new)}."),
            (changed, f"Changed in the file: {_some(changed)}."),
            (apart, f"The records of the two say different values of {_some(apart)}."),
            (self.held_out[0] != self.held_out[1], f"They judge different records: {judged}."),
        )
        return tuple(text for there, text in told if there)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""
        return {
            "schema": "casid.compare/1",
            **plain(self, "worse sentence names verdicts held_out together channels records causes"),
            "values": [plain(one, "name given flight std sigmas differs") for one in self.values],
        }

    def __str__(self) -> str:
        lines = [
            f"{'worse' if self.worse else 'not worse'}: {self.sentence}",
            *(f"  - {one}" for one in self.points),
            "",
            self.rows().text(),
            *(f"{one.name}: {one.sizes[0] or 'not named'} -> {one.sizes[1] or 'not named'}" for one in self.causes),
            *(
                f"{one.name}: as given {value_pair(one.given)}; by the records {flight_pair(one)}"
                for one in self.values
                if one.differs
            ),
        ]
        return "\n".join(lines)

    def rows(self) -> Rows:
        """Errors by channel on the held-out records, over the noise; those that changed most first."""
        return self.rows_of("error / noise", (self.together, *self.channels))

    def rows_of(self, head: str, errors: Iterable[ComparedError]) -> Rows:
        """Errors of channels or of records in both diagnoses, under the head of their names."""
        heads = [f"{which}, {name}" for which in ("as given", "left") for name in self.names]
        rows = [(named(one.name), *map(_in_words, (*one.as_given, *one.left))) for one in errors]
        return Rows(heads={head: "", **dict.fromkeys(heads, "s")}, rows=rows)


def named(channel: str) -> str:
    """Return a channel with its label, "pitch rate q"; a record as it is."""
    return " ".join(dict.fromkeys((label_of(channel), channel)))


def _in_words(error: float) -> str:
    return "diverges" if math.isinf(error) else "–" if math.isnan(error) else digits(error, 2)


def value_pair(values: tuple[float, float]) -> str:
    """Return two values in words, one where they are the same."""
    told = [digits(one) for one in values]
    return told[0] if told[0] == told[1] else " -> ".join(told)


def flight_pair(one: ComparedValue) -> str:
    """Return the two estimates with their deviations, and how far they are apart."""
    told = " -> ".join(with_deviation(value, std) for value, std in zip(one.flight, one.std, strict=True))
    apart = f"{digits(one.sigmas, 2)} standard deviations apart" if one.sigmas > 1.0 else "the same"
    return f"{told}, {apart}" if math.isfinite(one.sigmas) else told


def compare_diagnoses(first: str | Path, second: str | Path) -> Comparison:
    """Compare two diagnoses: two sets of records, or the same before and after a change of the file.

    Parameters
    ----------
    first, second
        Folders that `casid diagnose` wrote, or their diagnosis.json.

    Returns
    -------
    Comparison
        Errors, causes and values of both.

    Raises
    ------
    InputError
        For a folder without a whole diagnosis.

    Examples
    --------
    >>> import casid as cs
    >>> print(cs.compare_diagnoses("out/before", "out/after"))  # doctest: +SKIP
    """
    files = [Path(one) / "diagnosis.json" if os.path.isdir(one) else Path(one) for one in (first, second)]
    told = [read_diagnosis(file) for file in files]
    with sound(Path(f"{files[0]}, {files[1]}"), DIAGNOSIS):
        return _compared(_names(files), told)


def _names(files: list[Path]) -> tuple[str, str]:
    """Return short names of the two that differ."""
    first, second = (file.parent if file.name == "diagnosis.json" else file for file in files)
    if first == second:
        return first.name, f"{second.name} again"
    return (first.name, second.name) if first.name != second.name else (str(first), str(second))


def _compared(names: tuple[str, str], both: Sequence[Mapping[str, Any]]) -> Comparison:
    budgets = [one["budget"] for one in both]
    by_record = [{one["record"]: one for one in told.get("records") or []} for told in both]
    channels = _errors([one["channels"] for one in budgets], "structure")
    causes = [{one["name"]: _size(one) for one in told["causes"]} for told in both]
    return Comparison(
        names=names,
        verdicts=(str(both[0]["verdict"]), str(both[1]["verdict"])),
        held_out=(tuple(budgets[0]["records"]), tuple(budgets[1]["records"])),
        together=_error("all channels", [one["all"] for one in budgets], "structure"),
        channels=tuple(sorted(channels, key=lambda one: -_change(one))),
        records=tuple(_errors(by_record, "left")),
        causes=tuple(
            ComparedCause(name=name, sizes=(causes[0].get(name, ""), causes[1].get(name, "")))
            for name in dict.fromkeys([*causes[0], *causes[1]])
        ),
        values=tuple(sorted(_values([one["parameters"] for one in both]), key=lambda one: (not one.differs, one.name))),
    )


def _errors(tables: list[dict[str, Any]], left: str) -> Iterator[ComparedError]:
    for name in dict.fromkeys([*tables[0], *tables[1]]):
        yield _error(name, [table.get(name, {}) for table in tables], left)


def _error(name: str, steps: list[dict[str, Any]], left: str) -> ComparedError:
    return ComparedError(name=name, as_given=_pair(steps, "as_given", math.inf), left=_pair(steps, left, math.inf))


def _pair(tables: Sequence[Mapping[str, Any]], name: str, absent: float) -> tuple[float, float]:
    first, second = (_number(one, name, absent) for one in tables)
    return first, second


def _number(table: Mapping[str, Any], name: str, absent: float) -> float:
    """Return a number of a table; `absent` for one that is not finite, and NaN where the table does not have it."""
    if name not in table:
        return math.nan
    return absent if table[name] is None else float(table[name])


def _change(one: ComparedError) -> float:
    """Return by which factor an error changed; none where one side does not have it."""
    before, after = one.as_given
    if not (math.isfinite(before) and math.isfinite(after) and before > 0.0 and after > 0.0):
        return 0.0
    return abs(math.log(after / before))


def _size(cause: Mapping[str, Any]) -> str:
    unit = cause["unit"]
    size = with_deviation(float(cause["value"]), math.nan if cause["std"] is None else float(cause["std"]))
    sure = "" if cause.get("probability") is None else f", {100.0 * cause['probability']:.0f} % probable"
    return f"{size}{f' {unit}' if unit not in ('', '1') else ''}{sure}"


def _values(tables: Sequence[Mapping[str, Any]]) -> Iterator[ComparedValue]:
    for name in [one for one in tables[0] if one in tables[1]]:
        pair = [table[name] for table in tables]
        flight = [one.get("flight") or {} for one in pair]
        yield ComparedValue(
            name=name,
            given=_pair(pair, "a_priori", math.nan),
            flight=_pair(flight, "value", math.nan),
            std=_pair(flight, "std", math.inf),
        )


def _some(names: list[str]) -> str:
    """Return the first few of many names."""
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")


def _times(ratio: float) -> str:
    return f"{digits(ratio, 2)} times" if math.isfinite(ratio) else "beyond any multiple of"
