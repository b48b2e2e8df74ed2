"""Errors that name the fault, what was expected, and the nearest valid name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches

_LONGEST = 2000  # characters of a message


def printable(text: str) -> str:
    """Return a text with what is no printable character, such as a command to a terminal, as Python writes it."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class CasidError(Exception):
    """Base class of every error that casid raises on purpose; `str()` is one line of printable characters.

    Examples
    --------
    >>> import casid as cs
    >>> try:
    ...     cs.read_record("absent.csv")
    ... except cs.CasidError as error:
    ...     print(error)
    absent.csv: cannot be read: No such file or directory
    """

    def __str__(self) -> str:
        message = printable(super().__str__())
        return message if len(message) <= _LONGEST else f"{message[: _LONGEST // 2]} ... {message[-_LONGEST // 2 :]}"


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


_MOST_NAMES = 30  # that a message lists


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that `name` was probably meant to be, or None."""
    pool = list(valid)
    lowered = {v.lower(): v for v in reversed(pool)}
    match = get_close_matches(name[:200].lower(), list(lowered), n=1, cutoff=0.5)
    return lowered[match[0]] if match else None


def unknown(what: str, name: str, valid: Iterable[str], where: str = "") -> InputError:
    """An InputError for a name that does not exist: `what` is e.g. "channel", `where` a file."""
    pool = sorted(valid)
    name = str(name)
    near = nearest(name, pool)
    more = f" and {len(pool) - _MOST_NAMES} more" if len(pool) > _MOST_NAMES else ""
    hint = f"did you mean '{near}'?" if near else f"expected one of: {', '.join(pool[:_MOST_NAMES])}{more}"
    prefix = f"{where}: " if where else ""
    return InputError(f"{prefix}unknown {what} '{name if len(name) <= 60 else name[:57] + '...'}'; {hint}")


def check_known(what: str, names: Iterable[str], valid: Collection[str], where: str = "") -> None:
    """Raise the InputError of `unknown` for the first of the names that is not among the valid ones."""
    for name in names:
        if name not in valid:
            raise unknown(what, name, valid, where)


@contextmanager
def noting(failed: list[str] | None, what: str) -> Iterator[None]:
    """A block that draws, and notes its error in `failed`: a picture must not cost the results. Without a list it is
    raised."""
    try:
        yield
    except Exception as error:  # whatever a library, or the data of a stranger, may raise
        if failed is None:
            raise
        failed.append(f"{what}: {type(error).__name__}: {' '.join(str(error).split())}")
