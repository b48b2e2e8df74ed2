"""A part of an aircraft file: an effect that extends it, and its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from casid.arguments import given, identifier, number, numbers_by_name, one_line, sequence, table_of
from casid.errors import InputError, unknown
from casid.model.aircraft_file import numbers
from casid.model.vocabulary import KINDS, check_effect, effect_unit


@dataclass(frozen=True, kw_only=True)
class EffectValue:
    """A known effect and its size: one `[[effects]]` table.

    Attributes
    ----------
    target
        "" for a kind that has none.
    term
        Canonical name of the monomial, for a kind that needs one; else None.
    value
        In `unit` (SI), which is filled in from the vocabulary; meaning and sign: `vocabulary.KINDS`.
    std
        1-sigma of the value; 0 when it is exact.
    records
        Names of the records concerned; empty: all.
    onset_s
        Record name -> interval [s] in which the effect sets in; None: always there.
    parameters
        Further named numbers, e.g. a frequency, or the steps of further coefficients.

    Raises
    ------
    InputError
        When kind, target, term and unit do not fit together.

    Examples
    --------
    >>> import casid as cs
    >>> lag = cs.EffectValue(kind="actuator_lag", target="delta_e", value=0.12)
    >>> lag.unit
    's'
    >>> aircraft = cs.Aircraft.read("casid/cli/demo/aircraft.toml").with_effects([lag])
    >>> len(aircraft.effects)
    1
    """

    kind: str
    target: str = ""
    term: str | None = None
    value: float
    std: float = 0.0
    unit: str = ""
    records: tuple[str, ...] = ()
    onset_s: Mapping[str, tuple[float, float]] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    sentence: str = ""

    def __post_init__(self) -> None:
        where = f"effect '{one_line(self.kind, 'an effect: kind')}'"
        for key in ("target", "term", "unit"):
            if (given_text := getattr(self, key)) is not None:
                one_line(given_text, f"{where}: {key}")
        one_line(self.sentence, f"{where}: sentence", 2000)
        records = sequence(self.records, f"{where}: records", "a list of names")
        check_effect(self.kind, self.target, self.term, anywhere=True)
        unit = effect_unit(self.kind, self.target, self.term)
        if self.unit not in ("", unit):
            raise InputError(f"{where}: unit is {given(self.unit)}; expected '{unit}', a value in SI")
        values = {
            "target": self.target or "",
            "term": KINDS[self.kind].term_named(self.term),
            "value": number(self.value, f"{where}: value"),
            "std": number(self.std, f"{where}: std", least=0.0),
            "unit": unit,
            "records": tuple(one_line(name, f"{where}: a name in records") for name in records),
            "onset_s": self._onsets(where),
            "parameters": {
                identifier(name, f"{where}: a name in parameters"): size
                for name, size in numbers_by_name(self.parameters, f"{where}: parameters").items()
            },
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _onsets(self, where: str) -> dict[str, tuple[float, float]] | None:
        if self.onset_s is None:
            return None
        onsets = {}
        for record, interval in table_of(self.onset_s, f"{where}: onset_s", "{'m1': (9.0, 9.4)}").items():
            one_line(record, f"{where}: a name in onset_s")
            if self.records and record not in self.records:
                raise unknown("record", record, self.records, f"{where}: onset_s")
            low, high = numbers(interval, f"{where}: onset_s of '{record}'", 2)
            if low > high:
                raise InputError(f"{where}: onset_s of '{record}' runs backwards, [{low}, {high}]; earliest time first")
            onsets[record] = (low, high)
        return onsets or None
