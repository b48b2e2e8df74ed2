"""Bounds on what is read of a file: bytes, cells, depth, and the time and memory of a reader in a process of its own.

They lie far above what flight records and simulations have, and far below what stops a machine.
"""

from __future__ import annotations

import faulthandler
import gzip
import io
import json
import mmap
import os
import pickle
import signal
import sys
import tomllib
import warnings
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from casid.arguments import a_path
from casid.errors import InputError

MOST_BYTES = 1 << 29  # of a text, unpacked
MOST_BYTES_OF_A_MODEL = 1 << 25  # of an aircraft file or another simulation's file
MOST_CELLS = 50_000_000  # of a sheet
_BLOCK = 1 << 20  # bytes
MOST_DEPTH = 100  # of elements of XML
_MOST_MEMORY = 3 << 29  # bytes that a reader may take
# of processor time; the slowest reader, of sheets, takes half of that
_SECONDS = 10.0
_SECONDS_PER_MB = 10.0

Made = TypeVar("Made")


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a regular file, unpacked where it ends in .gz. InputError where that fails or has more than `most` bytes."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be read: is {'a folder' if path.is_dir() else 'no file but a device'}")
        packed = path.suffix.lower() == ".gz"
        with gzip.open(path) if packed else path.open("rb") as file:
            block = _BLOCK if packed else min(most, path.stat().st_size) + 1  # a larger one would be taken at once
            held = io.BytesIO()
            while held.tell() <= most and (part := file.read(block)):
                held.write(part)
            raw = held.getvalue()
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputError(f"{path}: not a whole .gz file; pack it again") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a zero in it
        raise InputError(f"{str(path)[:200]}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(raw) > most:
        raise InputError(f"{path}: has more than {most / 1e6:.0f} MB; take a part of it, or a lower rate")
    return raw


def read_text_of(path: Path) -> str:
    """Read the text of another simulation's file, UTF-8."""
    try:
        return read_bytes(path, MOST_BYTES_OF_A_MODEL).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8: byte {error.start}") from None


def read_json(path: Path, expected: str) -> dict[str, Any]:
    """Read the table of a JSON file. InputError for what is none, with what is `expected`."""
    try:
        found = json.loads(read_bytes(path))
    except (ValueError, RecursionError) as error:  # ValueError: bad JSON, bad UTF-8, a number of thousands of digits
        fault = str(error).splitlines()[0] if isinstance(error, ValueError) else "nested too deeply"
        raise InputError(f"{path}: no JSON: {fault}; expected {expected}") from None
    except InputError as error:
        raise InputError(f"{error}; expected {expected}") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds no table; expected {expected}")
    return found


def read_toml(path: str | Path) -> dict[str, Any]:
    """Content of a TOML file; raises InputError when it cannot be read or is not TOML."""
    raw = read_bytes(Path(path), MOST_BYTES_OF_A_MODEL)
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # ValueError: bad TOML, bad UTF-8, a number of thousands of digits
        fault = str(error).splitlines()[0] if str(error) else "nested too deeply"
        raise InputError(f"{path}: not valid TOML: {fault}") from None


@contextmanager
def sound(path: Path, expected: str) -> Iterator[None]:
    """A block that makes something of the content of a file: what it trips over is a fault of the file, an InputError
    with what is `expected`."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, LookupError, ArithmeticError) as error:
        fault = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: damaged: {type(error).__name__}: {fault}; expected {expected}") from None


@contextmanager
def of_file(place: str | Path) -> Iterator[None]:
    """A block that reads the content of a file, or of a part of one: its InputErrors name that place."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {str(error).removeprefix(f'{place}: ')}") from None


def xml_root(content: str | bytes) -> ET.Element:
    """Parse XML that is no deeper than `MOST_DEPTH`. Raises InputError."""
    parser = ET.XMLPullParser(("start", "end"))
    depth = 0
    root: Any = None
    try:
        for at in range(0, len(content), 1 << 16):
            parser.feed(content[at : at + (1 << 16)])
            for event, node in parser.read_events():  # pyright: ignore[reportAssignmentType]
                root = node if root is None else root
                depth += 1 if event == "start" else -1
                if depth > MOST_DEPTH:
                    raise InputError(f"is no XML that is read: elements are more than {MOST_DEPTH} deep")
        parser.close()
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"is no XML: {error}") from None
    if root is None:
        raise InputError("is no XML: no element found")
    return root


def beside(folder: Path, name: str, what: str) -> Path:
    """Find a file that another file of `folder` names; InputError for one that does not lie beside it or below."""
    file = folder / a_path(name, what)
    if not Path(os.path.realpath(file)).is_relative_to(os.path.realpath(folder)):
        raise InputError(f"{what}: '{name}' does not lie beside this file or below; put it there")
    return file


def apart(read: Callable[..., Made], path: Path, *arguments: Any, remedy: str = "save it as CSV") -> Made:
    """Call `read` in a process of its own, so that a library that crashes, loops or wants too much memory ends with it;
    outside Linux, here. Raises InputError, also what `read` raises."""
    if sys.platform != "linux" or not path.is_file():
        return _made(read, path, *arguments)
    seconds = int(_SECONDS + _SECONDS_PER_MB * path.stat().st_size / 1e6)
    source, sink = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads stay behind, none of which it needs
        child = os.fork()
    if child == 0:
        os.close(source)
        _answer(sink, seconds, read, path, *arguments)
    os.close(sink)
    try:
        with os.fdopen(source, "rb") as pipe:
            answer = pipe.read()
        _, status = os.waitpid(child, 0)
    except BaseException:
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise
    if answer and status == 0:
        made = pickle.loads(answer)  # of this process's own copy
        if isinstance(made, BaseException):
            raise made
        return made
    late = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL)
    why = f"was not read after {seconds} s" if late else "stopped its reader"
    raise InputError(f"{path}: {why}: damaged, or no {path.suffix} file; {remedy}")


def _made(read: Callable[..., Made], path: Path, *arguments: Any) -> Made:
    try:
        return read(path, *arguments)
    except MemoryError:
        raise InputError(f"{path}: needs too much memory to be read; take a part of it, or a lower rate") from None


def _answer(sink: int, seconds: int, read: Callable[..., Any], path: Path, *arguments: Any) -> None:
    """Write what `read` returns or raises, and end this process."""
    import resource

    try:
        faulthandler.disable()
        quiet = os.open(os.devnull, os.O_WRONLY)  # what a library prints about a damaged file
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(4 * seconds)  # of a clock on the wall, where it waits
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        memory = pages * mmap.PAGESIZE + _MOST_MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        try:
            made: Any = _made(read, path, *arguments)
        except Exception as error:  # raised again where it is asked for, if it can be made there
            known = type(error).__module__ in ("builtins", InputError.__module__)
            text = f"{path}: not a readable {path.suffix} file: {type(error).__name__}"
            made = error if known else InputError(text)
            made.__cause__ = made.__context__ = None  # which would come along where tblib is installed
        with os.fdopen(sink, "wb") as pipe:
            pickle.dump(made, pipe, protocol=5)
        os._exit(0)
    finally:
        os._exit(1)
