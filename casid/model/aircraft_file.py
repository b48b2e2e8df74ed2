"""TOML underneath the aircraft file: taking a table apart with clear errors, and a writer (the library has none)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from casid.arguments import given, number
from casid.errors import InputError, check_known

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)


def check_keys(table: Mapping[str, Any], valid: Iterable[str], section: str, required: Iterable[str] = ()) -> None:
    """Raise InputError for a key of `table` that is not `valid`, or a `required` one that is absent."""
    pool = tuple(valid)
    check_known("key", table, pool, section)
    for key in required:
        if key not in table:
            raise InputError(f"{section}: '{key}' is missing; add it")


def subtable(table: Mapping[str, Any], key: str, section: str) -> dict[str, Any]:
    """The table under `key`, empty when absent; raises InputError for anything else."""
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{section}: '{key}' is {given(value)}; expected a table of names and values")
    return value


def numbered(value: Any, name: str) -> list[tuple[str, dict[str, Any]]]:
    """(place in words, table) of each of the tables [[name]]; raises InputError for anything else."""
    if not isinstance(value, list) or not all(isinstance(table, dict) for table in value):
        raise InputError(f"{name.partition('.')[0]} are written as [[{name}]] tables, with double brackets")
    return [(f"[[{name}]] number {position}", table) for position, table in enumerate(value, start=1)]


def numbers(value: Any, what: str, count: int | None = None) -> tuple[float, ...]:
    """`value` as a tuple of finite floats, `count` of them when given; raises InputError."""
    if not isinstance(value, (list, tuple)) or (count is not None and len(value) != count):
        raise InputError(f"{what} is {given(value)}; expected a list of {count or 'finite'} numbers")
    return tuple(number(item, what) for item in value)


def text(value: Any, what: str) -> str:
    """`value` when it is a string; raises InputError."""
    if not isinstance(value, str):
        raise InputError(f"{what} is {given(value)}; expected a text in quotes")
    return value


def toml_text(sections: Iterable[tuple[str, Mapping[str, Any]]]) -> str:
    """TOML of (header, table) pairs in their order; a header is e.g. "[aircraft]" or "[[effects]]". Values are numbers,
    texts, lists, and inline tables. Floats are read back equal."""
    blocks = []
    for header, table in sections:
        lines = [header, *(f"{quoted(key)} = {_value(value)}" for key, value in table.items())]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def quoted(key: str) -> str:
    """A key as TOML wants it, in quotes where it is not bare."""
    return key if _BARE_KEY.fullmatch(key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, str):
        # A JSON string is a TOML basic string but for DEL, which JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        inside = ", ".join(f"{quoted(key)} = {_value(item)}" for key, item in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    return repr(float(value))
