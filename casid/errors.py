"""Errors that name the fault, what was expected, and the nearest valid name."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class CasidError(Exception):
    """Base class of every error that casid raises on purpose; `str()` is one line.

    Examples
    --------
    >>> import casid as cs
    >>> try:
    ...     cs.read_record("absent.csv")
    ... except cs.CasidError as error:
    ...     print(error)
    absent.csv: cannot be read: No such file or directory
    """


class InputError(CasidError):
    """Bad input from the user, such as a file, a name or a value. Commands end with exit status 2.

    Examples
    --------
    >>> import casid as cs
    >>> cs.read_record("absent.csv")
    Traceback (most recent call last):
    casid.errors.InputError: absent.csv: cannot be read: No such file or directory
    """


class EstimationError(CasidError):
    """An estimation that cannot be carried out as it was posed.

    Examples
    --------
    >>> import casid as cs
    >>> cs.limit_parameter("Cm_q", lower=1.0, upper=0.0)
    Traceback (most recent call last):
    casid.errors.EstimationError: constraint on 'Cm_q': lower 1 is above upper 0
    """


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that `name` was probably meant to be, or None."""
    pool = list(valid)
    lowered = {v.lower(): v for v in reversed(pool)}
    match = get_close_matches(name.lower(), list(lowered), n=1, cutoff=0.5)
    return lowered[match[0]] if match else None


def unknown(what: str, name: str, valid: Iterable[str], where: str = "") -> InputError:
    """An InputError for a name that does not exist: `what` is e.g. "channel", `where` a file."""
    pool, name = sorted(valid), str(name)
    near = nearest(name, pool)
    hint = f"did you mean '{near}'?" if near else f"expected one of: {', '.join(pool)}"
    prefix = f"{where}: " if where else ""
    return InputError(f"{prefix}unknown {what} '{name}'; {hint}")
