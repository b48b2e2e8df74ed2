"""Leave a command, from the first import to the end, with one line and a true status, whatever happens.

This is imported before all that is slow, and is therefore made of the standard library and the errors alone.
"""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import NoReturn

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)
_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_IMPORTERS = ("<frozen importlib._bootstrap>", "<frozen importlib._bootstrap_external>")
_received: list[int] = []  # signals that came after `ready`: an import in mid-air may swallow what they raise


class Terminated(BaseException):
    """SIGTERM, raised where the program stands, so that folders that are half written are taken away."""


def begin() -> dict[int, object]:
    """While things are imported, Ctrl-C and SIGTERM end the process on the spot. Returns the handlers of before."""
    # Models are hundreds of thousands of small objects that stay, which the default looks through again and again.
    gc.set_threshold(100_000)
    _received.clear()
    before: dict[int, object] = {}
    for number in _WORDS:
        if signal.getsignal(number) is signal.SIG_IGN:
            continue  # as a shell starts what runs in the background
        try:
            before[number] = signal.signal(number, _leave)
        except ValueError:  # not the main thread: the signals are not ours
            return {}
    return before


def ready() -> None:
    """Let Ctrl-C and SIGTERM stop the program at once from now on."""
    for number in _WORDS:
        if signal.getsignal(number) is _leave:  # otherwise nobody began: the signals are not ours
            signal.signal(number, _stop)


def outcome(action: Callable[[], int | None]) -> int:
    """The exit status of an action: 2 and one line on standard error for bad input, 130 for Ctrl-C, 143 for SIGTERM.

    Every other exception stays as it is, because it is a defect of ours.
    """
    before = begin()
    try:
        return action() or 0
    except BrokenPipeError:
        return 1
    except (KeyboardInterrupt, Terminated):
        return _stopped()
    except Exception as error:
        if _received:  # what a library made of it
            return _stopped()
        return _said(error)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)  # pyright: ignore[reportArgumentType]


def run_script(main: Callable[[], int | None]) -> NoReturn:
    """Run a script's `main` and leave with its status."""

    def action() -> int | None:
        ready()
        return main()

    leave(outcome(action))


def leave(status: int) -> NoReturn:
    """End the process; who asks for it once more is not heard any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(status)


def _imported_by_a_script() -> bool:
    """Return True if the file that is run imports this itself, and no worker process does."""
    frame = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename in (__file__, *_IMPORTERS):
        frame = frame.f_back
    return frame is not None and frame.f_globals.get("__name__") == "__main__"


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, f"{_WORDS[signal.Signals(number)]}; nothing had begun\n".encode())
    os._exit(128 + number)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    _received.append(number)
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def _stopped() -> int:
    if _received:  # from `_stop`, so that the signals are ours: a second one must not end the message
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    number = _received[0] if _received else signal.SIGINT
    print(f"{_WORDS[signal.Signals(number)]}; nothing half-written was left", file=sys.stderr)
    return 128 + number


def _said(error: Exception) -> int:
    from casid.errors import CasidError

    if isinstance(error, CasidError):
        message = str(error)
    elif isinstance(error, OSError) and error.errno in _NO_NAME:
        message = f"{str(error.filename)[:100]}: {error.strerror}; give the name of a file"
    elif isinstance(error, OSError) and error.errno in _NO_ROOM:
        message = f"the disk is full{f', at {error.filename}' if error.filename else ''}; nothing was changed"
    elif isinstance(error, MemoryError):
        message = "there is not enough memory; nothing was changed; take shorter records or a lower rate"
    else:
        raise error
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2


if _imported_by_a_script():  # scripts import this before all else, and are quiet from there on
    begin()
