"""Column maps: which column of a foreign file is which channel, in which unit.

A column is written `NAME`, `NAME:unit` or, where columns have no names, by its number from 1: `12:deg`. A weight may
stand before or behind, `12:deg*-1`; a channel may be a weighted sum, `["0.5*28:deg", "-0.5*27:deg"]`. The column
`row` is the number of the row from 0, unless a column is called so: `t = "row*0.02"` is a time of rows at 50 Hz.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from casid.arguments import a_path, given, is_path, require, sequence, table_of
from casid.errors import InputError, check_known
from casid.records.limits import read_toml
from casid.signals import is_unit

_WEIGHT = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?"
_TERM = re.compile(rf"\s*(?:({_WEIGHT})\s*\*)?\s*([^*]+?)\s*(?::\s*([^:*]+?))?\s*(?:\*\s*({_WEIGHT}))?\s*", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class ColumnTerm:
    """One column of a channel: name, or number from 1; unit, "" for SI or that of the header; weight."""

    column: str | int
    unit: str = ""
    weight: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """Which columns of a file are which channels.

    Attributes
    ----------
    columns
        Channel -> columns whose weighted sum it is.
    variable
        Name of the matrix of a .mat or .npz file; None if the file has one only.

    Examples
    --------
    >>> import casid as cs
    >>> columns = cs.ColumnMap.of({"alpha": "ALCG:deg", "q": "QCG:deg/s"})
    >>> list(columns.columns)
    ['alpha', 'q']
    """

    columns: Mapping[str, tuple[ColumnTerm, ...]] = field(default_factory=dict)
    variable: str | None = None

    def __post_init__(self) -> None:
        like = "cs.ColumnMap.of({'alpha': 'ALCG:deg'})"
        for channel, terms in table_of(self.columns, "ColumnMap: columns", f"that of {like}").items():
            for term in sequence(terms, f"ColumnMap: columns of '{channel}'", f"what {like} makes"):
                require(term, ColumnTerm, f"ColumnMap: columns of '{channel}': one", like)
        if self.variable is not None:
            require(self.variable, str, "ColumnMap: variable", "the name of a matrix in quotes, or None")

    @classmethod
    def of(cls, value: ColumnMap | Mapping[str, Any] | str | Path | None) -> ColumnMap:
        """A map as a caller may give it: itself, its TOML file, a table like {"alpha": "ALCG:deg"}, or None."""
        if isinstance(value, ColumnMap):
            return value
        if isinstance(value, Mapping):
            for channel in value:
                if not isinstance(channel, str):
                    raise InputError(f"column map: {given(channel)} is no channel; expected a name in quotes")
            return cls(columns={c: _terms(v, f"column map of '{c}'") for c, v in value.items()})
        if is_path(value):
            return cls.read(value)
        if value is None:
            return cls()
        raise InputError(f"column map is {given(value)}; expected a TOML file or a table like {{'alpha': 'ALCG:deg'}}")

    @classmethod
    def read(cls, path: str | Path) -> ColumnMap:
        """The map of a TOML file: `variable = "NAME"` (optional) and a table [columns], `alpha = "12:deg"`."""
        data = read_toml(a_path(path, "ColumnMap.read"))
        check_known("key", data, ("columns", "variable"), str(path))
        columns = data.get("columns")
        variable = data.get("variable")
        if not isinstance(columns, dict) or not columns:
            raise InputError(f'{path}: a column map needs a table [columns] with lines like alpha = "12:deg"')
        if variable is not None and not isinstance(variable, str):
            raise InputError(f"{path}: 'variable' must be a name in quotes, got {variable!r:.40}")
        return cls(columns={c: _terms(v, f"{path}: [columns] {c}") for c, v in columns.items()}, variable=variable)

    @classmethod
    def from_options(cls, options: Iterable[str]) -> ColumnMap:
        """The map that `--map` options make together: TOML files and `channel=column` settings, later ones win."""
        result = cls()
        for option in options:
            result = result.merged(parse_map_option(option) if "=" in option else cls.read(option))
        return result

    def merged(self, other: ColumnMap) -> ColumnMap:
        """Both maps; `other` wins where both speak of one channel."""
        return ColumnMap(columns={**self.columns, **other.columns}, variable=other.variable or self.variable)


def parse_map_option(option: str) -> ColumnMap:
    """The map of one `--map` setting, `alpha=ALCG:deg` or `delta_a=0.5*28:deg,-0.5*27:deg`; InputError for everything
    else."""
    channel, equals, columns = option.partition("=")
    if not equals or not channel.strip() or not columns.strip():
        raise InputError(f"--map '{option}': expected channel=column or channel=column:unit, like alpha=ALCG:deg")
    return ColumnMap(columns={channel.strip(): _terms(columns.split(","), f"--map '{option}'")})


def _terms(value: Any, where: str) -> tuple[ColumnTerm, ...]:
    items = value if isinstance(value, list) else [value]
    if not items:
        raise InputError(f"{where}: no column; expected a name or a number, like 'ALCG:deg' or '12:deg'")
    return tuple(_term(item, where) for item in items)


def _term(item: Any, where: str) -> ColumnTerm:
    text = str(item) if isinstance(item, int) and not isinstance(item, bool) else item
    match = _TERM.fullmatch(text) if isinstance(text, str) else None
    name = match[2] if match else ""
    odd = name.startswith(":") or (":" in name and bool(match and match[3] and not is_unit(match[3])))
    if not match or odd or (match[1] and match[4]):
        raise InputError(
            f"{where}: {item!r:.40} is not a column; expected NAME:unit or NUMBER:unit, with a weight as in '12:deg*-1'"
        )
    weight, name, unit, behind = match.groups()
    column: str | int = int(name) if name.isdecimal() and name.isascii() and len(name) < 7 else name
    return ColumnTerm(column=column, unit=unit or "", weight=float(weight or behind or 1.0))
