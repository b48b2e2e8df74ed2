"""Checks of what a caller gives to a function: the value itself, or an InputError with what to write instead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from casid.errors import InputError, nearest

Kind = TypeVar("Kind")


def given(value: Any) -> str:
    """A value as an error names it, on one line and never long: numbers and texts as they are, all else by kind."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if value is None or isinstance(value, (bool, int, float)):
        return repr(value) if not isinstance(value, int) or abs(value) < 1e15 else "a number too large"
    if isinstance(value, str):
        return f"the text {value if len(value) <= 40 else value[:37] + '...'!r}"
    if isinstance(value, (list, tuple, dict, set, frozenset)):
        return f"a {type(value).__name__} of {len(value)}"
    name = type(value).__name__
    return f"{'an' if name[:1] in 'AEIOU' else 'a'} {name}"


def is_path(value: Any) -> TypeGuard[str | Path]:
    """Return True if a value can name a file."""
    return isinstance(value, (str, Path))


_LONGEST_NAME = 255  # bytes


def a_path(value: Any, what: str) -> Path:
    """`value` as the name of a file; InputError for anything else."""
    if is_path(value):
        for part in Path(value).parts:
            if len(part.encode(errors="replace")) > _LONGEST_NAME or "\0" in part:
                raise InputError(f"{what}: '{part:.60}' cannot be the name of a file")
        return Path(value)
    raise InputError(f"{what}: the path is {given(value)}; expected a file name")


def one_of(value: Any, valid: Iterable[str], what: str) -> str:
    """`value` when it is one of these texts; InputError that names the nearest otherwise."""
    pool = tuple(valid)
    if isinstance(value, str) and value in pool:
        return value
    near = nearest(value, pool) if isinstance(value, str) else None
    hint = f"did you mean '{near}'?" if near else f"expected {' or '.join(map(repr, pool))}"
    raise InputError(f"{what} is {given(value)}; {hint}")


_LONGEST_NAME = 200


def one_line(value: Any, what: str, most: int = _LONGEST_NAME) -> str:
    """Return `value` when it is a text of one line, of `most` printable characters; InputError otherwise."""
    if not isinstance(value, str):
        raise InputError(f"{what} is {given(value)}; expected a text in quotes")
    if not value.isprintable() or len(value) > most:
        raise InputError(f"{what} is {given(value)}; expected one line of printable characters, {most} at most")
    return value


def identifier(value: Any, what: str) -> str:
    """Return `value` when it can be a name in code: letters of ASCII, digits and _, no digit first; InputError
    otherwise."""
    if not (isinstance(value, str) and value.isascii() and value.isidentifier() and len(value) <= _LONGEST_NAME):
        raise InputError(f"{what} is {given(value)}; expected a name of letters, digits and _, like frequency")
    return value


def sequence(value: Any, what: str, of: str) -> tuple[Any, ...]:
    """Return the members of a list, tuple or array; InputError, which names `of`, for anything else."""
    if not isinstance(value, (list, tuple)) and not getattr(value, "ndim", 0):
        raise InputError(f"{what} is {given(value)}; expected {of}")
    return tuple(value)


def table_of(value: Any, what: str, like: str) -> Mapping[str, Any]:
    """`value` when it is a table whose keys are names; InputError that shows one `like` it otherwise."""
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        return value
    raise InputError(f"{what} is {given(value)}; expected a table like {like}")


def require(value: Any, kind: type[Kind] | tuple[type[Kind], ...], what: str, write: str) -> Kind:
    """`value` when it is of the kind; else InputError: `what` it is and what to `write`, like "cs.OutputError()"."""
    if isinstance(value, kind):
        return value
    raise InputError(f"{what} is {given(value)}; write {write}")


def number(value: Any, what: str, *, least: float | None = None, positive: bool = False) -> float:
    """`value` as a finite float, not below `least`; InputError otherwise."""
    wanted = "a positive number" if positive else "a finite number" if least is None else f"a number from {least:g} on"
    plain = value.item() if getattr(value, "shape", None) == () else value  # a numpy scalar
    try:
        result = math.nan if isinstance(plain, bool) or not isinstance(plain, Real) else float(plain)
    except OverflowError:  # an integer of hundreds of digits
        result = math.nan
    if not math.isfinite(result) or (positive and result <= 0.0) or (least is not None and result < least):
        stands = given(plain) if math.isnan(result) else f"{result:g}"
        raise InputError(f"{what} is {stands}; expected {wanted}")
    return result


def whole(value: Any, what: str, least: int = 1) -> int:
    """`value` as an int from `least` on; InputError otherwise, for 20.5 and True as well."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{what} is {given(value)}; expected a whole number of at least {least}")
    return int(value)


def names(value: Any, what: str) -> tuple[str, ...]:
    """`value` as texts; InputError for one text alone, and for what is no text."""
    if isinstance(value, str):
        raise InputError(f"{what} is {given(value)}; expected a list of names: write [{value!r}]")
    if isinstance(value, Mapping) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        raise InputError(f"{what} is {given(value)}; expected a list of names, like ['Cm_alpha', 'Cm_q']")
    found = tuple(value)
    for one in found:
        if not isinstance(one, str):
            raise InputError(f"{what} has {given(one)} in it; expected names in quotes")
    return found


def numbers_by_name(value: Any, what: str) -> dict[str, float]:
    """`value` as a table name -> finite number; InputError otherwise."""
    table_of(value, what, "{'Cm_alpha': -1.2}")
    return {  # most are floats: models are made again and again with the same hundred numbers
        name: one if type(one) is float and math.isfinite(one) else number(one, f"{what}: '{name}'")
        for name, one in value.items()
    }


def listed(values: Iterable[str], most: int = 12) -> str:
    """Names in a row, for a `repr`: the first ones, and how many more there are."""
    pool = list(values)
    more = f", ... ({len(pool)} in all)" if len(pool) > most else ""
    return (", ".join(pool[:most]) or "none") + more
