"""From the words of a command line to a function: one line and status 2 for bad input, 130 for Ctrl-C."""

from __future__ import annotations

import errno
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import NoReturn

from cyclopts import App, CycloptsError

from casid.errors import CasidError, InputError

_TERMINATED = 143  # 128 + SIGTERM, as shells say it
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class _Terminated(BaseException):
    """SIGTERM, raised where the program stands, so that folders that are half written are taken away."""


def run(command: Callable[..., int | None], arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one function as a script: its parameters are the options."""
    run_app(script(command), arguments)


def script(command: Callable[..., int | None], name: str | None = None) -> App:
    """The application of a script: one function, under the name it was called by."""
    name = name or sys.argv[0].rsplit("/", 1)[-1] or "casid"
    return App(name=name, default_command=command, version_flags=[], suppress_keyboard_interrupt=False)


def run_app(app: App, arguments: Sequence[str] | None = None) -> NoReturn:
    """Run an application and leave with its status.

    Bad input is one line on standard error and status 2; Ctrl-C is status 130, SIGTERM 143. Every other exception
    stays a traceback, because it is a defect of ours.
    """
    sys.exit(status_of(app, arguments))


def status_of(app: App, arguments: Sequence[str] | None = None) -> int:
    """The exit status of a run; see `run_app`."""
    try:
        before = signal.signal(signal.SIGTERM, _raise)
    except ValueError:  # not the main thread: the signal is not ours
        before = None
    try:
        return call(app, sys.argv[1:] if arguments is None else arguments)
    except CasidError as error:
        return _said(str(error))
    except BrokenPipeError:
        return 1
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        return _said(f"the disk is full{f', at {error.filename}' if error.filename else ''}; nothing was changed")
    except KeyboardInterrupt:
        print("interrupted; nothing half-written was left", file=sys.stderr)
        return 130
    except _Terminated:
        print("terminated; nothing half-written was left", file=sys.stderr)
        return _TERMINATED
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)


def call(app: App, arguments: Sequence[str]) -> int:
    """Run an application in this process; words that it cannot take are an InputError like all bad input."""
    try:
        status = app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        raise InputError(f"{' '.join(str(error).split()).rstrip('.')}; see {app.name[0]} --help") from None
    return status if isinstance(status, int) else 0


def _raise(number: int, frame: FrameType | None) -> NoReturn:
    raise _Terminated


def _said(message: str) -> int:
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2
