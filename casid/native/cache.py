"""The folder of compiled libraries: owned by the user alone, checked by content, bounded in size.

What is loaded is executed. A folder that somebody else owns or may write to, or may put another in the place of, is
therefore not used, nor is a library of somebody else. A library is named by the checksum of its content, so that a
truncated or foreign one is built again instead of loaded.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import threading
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import platformdirs

_LOG = logging.getLogger(__name__)
MOST_BYTES = 300_000_000  # of all libraries; the longest unused go first
_seen: dict[Path, tuple[float, int]] = {}  # libraries checked by this process: modification time, size
_names: dict[Path, tuple[int, tuple[str, ...]]] = {}  # folder -> its modification time, the libraries there, sorted


def cache_folder() -> Path:
    """Return the folder that keeps compiled libraries between runs: ``casid`` in the user's cache folder."""
    return platformdirs.user_cache_path("casid")


def find(key: str) -> Path | None:
    """Find the library of a key whose content has the checksum of its name, and that loads on this machine."""
    with suppress(OSError):  # a folder that cannot be read holds nothing for us
        if not cache_folder().exists():
            return None  # nothing is made before something is compiled
        for library in _of_key(_folder(cache_folder()), key):
            if _is_whole(library) and _loads_or_goes(library):
                with suppress(OSError):
                    os.utime(library)  # the longest unused go first
                state = library.stat()
                _seen[library] = (state.st_mtime, state.st_size)
                return library
    return None


def _of_key(folder: Path, key: str) -> list[Path]:
    """The libraries of a key. The folder, which may hold thousands, is listed again only after it has changed."""
    changed = folder.stat().st_mtime_ns
    if _names.get(folder, (None, ()))[0] != changed:
        _names[folder] = changed, tuple(sorted(name for name in os.listdir(folder) if name.endswith(".so")))
    names = _names[folder][1]  # "." is the character after "-"
    return [folder / name for name in names[bisect_left(names, f"{key}-") : bisect_left(names, f"{key}.")]]


def check_loads(library: Path) -> None:
    """Raise OSError for a library that does not load here: garbage, a foreign one, a mount without execution."""
    ctypes.CDLL(str(library))


def _loads_or_goes(library: Path) -> bool:
    try:
        check_loads(library)
    except OSError as error:
        _LOG.warning("%s: does not load, and is built again: %s", library, str(error)[-200:])
        library.unlink(missing_ok=True)
        return False
    return True


def keep(key: str, binary: Path) -> Path:
    """Take a library into the cache, in one step: another process sees the whole library or none."""
    folder = _folder(cache_folder())
    library = folder / f"{key}-{_checksum(binary)}.so"
    binary.chmod(0o700)
    os.replace(binary, library)
    _bound(folder, library)
    return library


@contextmanager
def workshop() -> Iterator[Path]:
    """A folder of this process for everything that compiling writes; what a killed process left is swept first."""
    folder = _folder(cache_folder())
    for left in folder.glob("building-*"):
        process = left.name.split("-")[1]
        if process.isdigit() and not _alive(int(process)):
            shutil.rmtree(left, ignore_errors=True)
    place = folder / f"building-{os.getpid()}-{threading.get_ident()}"
    place.mkdir(exist_ok=True)
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)


@cache
def _folder(wanted: Path) -> Path:
    """The cache folder, or one of this process alone where that cannot be trusted (reported once)."""
    try:
        wanted.mkdir(parents=True, exist_ok=True, mode=0o700)
        if _is_ours(wanted):
            return wanted
        why = "belongs to somebody else, or others may write there"
    except OSError as error:
        why = error.strerror or str(error)
    _LOG.warning("%s: %s; compiled code is kept for this run only", wanted, why)
    private = Path(tempfile.mkdtemp(prefix="casid-"))
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    return private


def _is_ours(folder: Path) -> bool:
    """Return True if the folder is a real one of this user, into which nobody else may write."""
    if not hasattr(os, "getuid"):
        return True
    return stat.S_ISDIR(folder.lstat().st_mode) and _of_us_alone(folder.lstat()) and _stays(folder)


def _of_us_alone(state: os.stat_result) -> bool:
    """Return True if this user owns something into which nobody else may write."""
    return state.st_uid == os.getuid() and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _stays(folder: Path) -> bool:
    """Return True if nobody else may put another folder in the place of this one, or of one above it."""
    for above in Path(os.path.realpath(folder)).parents:
        state = above.stat()
        if state.st_uid not in (0, os.getuid()):
            return False
        shared = state.st_mode & stat.S_IWOTH or (state.st_mode & stat.S_IWGRP and not _is_own_group(state.st_gid))
        if shared and not state.st_mode & stat.S_ISVTX:  # where that is set, each may replace what is their own
            return False
    return True


def _is_own_group(group: int) -> bool:
    """Return True for the group that has the name of the user, who alone is in it."""
    import grp
    import pwd

    with suppress(KeyError):
        found = grp.getgrgid(group)
        own = pwd.getpwuid(os.getuid()).pw_name
        return found.gr_name == own and set(found.gr_mem) <= {own}
    return False


def _is_whole(library: Path) -> bool:
    state = library.lstat()
    if not stat.S_ISREG(state.st_mode) or (hasattr(os, "getuid") and not _of_us_alone(state)):
        return False
    if _seen.get(library) == (state.st_mtime, state.st_size):
        return True
    return library.stem.rpartition("-")[2] == _checksum(library)


def _checksum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:32]


def _bound(folder: Path, newest: Path) -> None:
    """Delete the longest unused libraries until the rest fits."""
    with suppress(OSError):
        libraries = sorted(folder.glob("*.so"), key=lambda library: library.stat().st_mtime)
        total = sum(library.stat().st_size for library in libraries)
        for library in libraries:
            if total <= MOST_BYTES:
                return
            if library != newest:
                total -= library.stat().st_size
                library.unlink(missing_ok=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
