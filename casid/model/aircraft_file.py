"""TOML underneath the aircraft file: taking a table apart with clear errors, and a writer (the library has none)."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from casid.errors import InputError, unknown

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)


def check_keys(table: Mapping[str, Any], valid: Iterable[str], section: str, required: Iterable[str] = ()) -> None:
    """Raise InputError for a key of `table` that is not `valid`, or a `required` one that is absent."""
    pool = tuple(valid)
    for key in table:
        if key not in pool:
            raise unknown("key", key, pool, section)
    for key in required:
        if key not in table:
            raise InputError(f"{section}: '{key}' is missing; add it")


def subtable(table: Mapping[str, Any], key: str, section: str) -> dict[str, Any]:
    """The table under `key`, empty when absent; raises InputError when something else stands there."""
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{section}: '{key}' must be a table of names and values, got {shown(value)}")
    return value


def number(value: Any, what: str, *, positive: bool = False, non_negative: bool = False) -> float:
    """`value` as a finite float; raises InputError, `what` names it in the message."""
    wanted = "a positive number" if positive else "a number not below zero" if non_negative else "a finite number"
    try:
        result = math.nan if isinstance(value, (bool, str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result) or (positive and result <= 0.0) or (non_negative and result < 0.0):
        raise InputError(f"{what} must be {wanted}, got {shown(value)}")
    return result


def numbers(value: Any, what: str, count: int | None = None) -> tuple[float, ...]:
    """`value` as a tuple of finite floats, `count` of them when given; raises InputError."""
    if not isinstance(value, (list, tuple)) or (count is not None and len(value) != count):
        raise InputError(f"{what} must be a list of {count or 'finite'} numbers, got {shown(value)}")
    return tuple(number(item, what) for item in value)


def number_table(value: Any, what: str) -> dict[str, float]:
    """`value` as a name -> finite float table in its order; raises InputError."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what} must be a table of names and numbers, got {shown(value)}")
    return {key: number(item, f"{what}: '{key}'") for key, item in value.items()}


def text(value: Any, what: str) -> str:
    """`value` when it is a string; raises InputError."""
    if not isinstance(value, str):
        raise InputError(f"{what} must be a text in quotes, got {shown(value)}")
    return value


def shown(value: Any) -> str:
    """A value for a one-line message, cut when it is long; an integer of thousands of digits cannot be printed."""
    try:
        result = repr(value)
    except ValueError:
        return "a number too large"
    return result if len(result) <= 40 else result[:37] + "..."


def toml_text(sections: Iterable[tuple[str, Mapping[str, Any]]]) -> str:
    """TOML of (header, table) pairs in their order; a header is e.g. "[aircraft]" or "[[effects]]".

    Values are numbers, texts, lists, and tables, which are written inline. Floats are written so that they are read
    back equal.
    """
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
