"""Call a function with the words of a command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from cyclopts import App, CycloptsError

from casid.cli.start import leave, outcome, ready
from casid.errors import EstimationError, InputError


def script(command: Callable[..., int | None], name: str | None = None) -> App:
    """The application of a script: one function, under the name it was called by."""
    name = name or sys.argv[0].rsplit("/", 1)[-1] or "casid"
    return App(name=name, default_command=command, version_flags=[])


def run(command: Callable[..., int | None]) -> NoReturn:
    """Run one function as a script: its parameters are the options."""
    leave(status_of(script(command)))


def status_of(app: App, arguments: Sequence[str] | None = None) -> int:
    """The exit status of a run, see `outcome`."""
    return outcome(lambda: call(app, arguments))


def _every_map(words: Sequence[str]) -> list[str]:
    """Words in which each of several settings behind one --map has its own: `--map alpha=A beta=B file.csv`."""
    found: list[str] = []
    mapping = False
    for word in words:
        mapping = mapping and "=" in word and not word.startswith("-")
        found += ["--map", word] if mapping and found[-1] != "--map" else [word]
        mapping = mapping or word == "--map"
    return found


def call(app: App, arguments: Sequence[str] | None = None) -> int:
    """Run an application in this process; words that it cannot take, or no estimation can, are an InputError."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        command, bound, _ = app.parse_args(_every_map(words), exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise InputError(f"{' '.join(str(error).split()).rstrip('., …')}; see {app.name[0]} --help") from None
    ready()
    try:
        status = command(*bound.args, **bound.kwargs)
    except EstimationError as error:  # of numbers and names that the words gave
        raise InputError(str(error)) from None
    return status if isinstance(status, int) else 0
