"""Output folders that are whole or not there at all, and what a result was made with."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import platform
import re
import secrets
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from casid.errors import InputError

try:
    import fcntl
except ImportError:  # Windows: what a killed run left stays
    fcntl = None

_PACKAGES = ("casid", "casadi", "numpy", "scipy", "matplotlib")
_ROOT = Path(__file__).resolve().parent.parent.parent


_UNFINISHED = ".casid-unfinished"  # is in a folder until it is whole
_PLAN = ".casid-plan"  # names of what is moved, one after the other
_EXCHANGE = 2  # of renameat2


def out_folder(text: str) -> Path:
    """The folder that is called so; "" would silently be the current one."""
    if not text.strip():
        raise InputError("--out is empty; name a folder for the results, like out")
    return Path(text)


@contextmanager
def whole_folder(folder: str | Path) -> Iterator[Path]:
    """Make a folder beside `folder`, which takes its place in one step when the block ends well.

    What was there under the same names is gone then, other files go over; modes stay. The name is random, no link is
    followed, and what a killed run left is taken away. A folder that cannot be renamed, such as the one in which the
    user stands, gets its files one by one, all or none. Raises InputError before any work is done when nothing can be
    written.
    """
    target = Path(os.path.abspath(folder))
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        what = "a link" if target.is_symlink() else "a file"
        raise InputError(f"{folder}: cannot be written to: is {what}; choose another --out")
    made = [place for place in target.parents if not place.exists()]  # the deepest first
    fixed = _cannot_be_renamed(target)
    lock = None
    temporary = (target if fixed else target.parent) / f".{target.name}-{secrets.token_hex(8)}"
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            _sweep(target)
            _begin(temporary, stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o777)
            lock = _locked(temporary)
        except OSError as error:
            raise InputError(
                f"{folder}: cannot be written to: {error.strerror or error}; choose another --out"
            ) from None
        yield temporary
        _put_in_place(temporary, target, fixed, folder)
    finally:
        if (temporary / _UNFINISHED).is_file():
            shutil.rmtree(temporary, ignore_errors=True)
        if lock is not None:
            os.close(lock)
        for place in made:
            with suppress(OSError):
                place.rmdir()


def _begin(folder: Path, mode: int) -> None:
    """Make a folder that is marked as unfinished; none is left where a signal comes between."""
    try:
        folder.mkdir(mode)
        (folder / _UNFINISHED).touch()
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _cannot_be_renamed(target: Path) -> bool:
    """Judge a folder that is there: a mount, the one of this process or above it, or in a folder that is not ours."""
    if not target.exists():
        return False
    with suppress(OSError):
        if Path.cwd().is_relative_to(target.resolve()):
            return True
    return os.path.ismount(target) or not os.access(target.parent, os.W_OK)


def _keep_modes(temporary: Path, target: Path) -> None:
    """Give what is new the modes of what it takes the place of."""
    for new, old in ((item, target / item.relative_to(temporary)) for item in (temporary, *temporary.rglob("*"))):
        if old.exists() and not old.is_symlink() and not new.is_symlink() and old.is_dir() == new.is_dir():
            new.chmod(stat.S_IMODE(old.stat().st_mode))


def _put_in_place(temporary: Path, target: Path, fixed: bool, folder: str | Path) -> None:
    """Give a folder its name and its modes; InputError where the system refuses that."""
    try:
        _keep_modes(temporary, target)
        if fixed:
            _move_in(temporary, target)
        else:
            _take_place(temporary, target)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _take_place(temporary: Path, target: Path) -> None:
    """Rename a whole folder to its name; what else was under that name is in it by then."""
    for item in target.iterdir() if target.exists() else ():
        if item.name != _UNFINISHED and not os.path.lexists(temporary / item.name):
            _bring_over(item, temporary / item.name)
    old = temporary
    if target.exists() and not _exchanged(temporary, target):
        old = temporary.with_name(f".{target.name}-{secrets.token_hex(8)}")
        target.rename(old)
        try:
            temporary.rename(target)
        except BaseException:
            old.rename(target)
            raise
    elif not target.exists():
        temporary.rename(target)
    with suppress(OSError):  # the next run finishes what is left
        _hand_over(old, target)


def _bring_over(item: Path, place: Path) -> None:
    """Link what is in a folder into the one that replaces it; nothing where the system has no such links."""
    try:
        if item.is_dir() and not item.is_symlink():
            shutil.copytree(item, place, symlinks=True, copy_function=os.link)
        else:
            os.link(item, place, follow_symlinks=False)
    except shutil.Error:  # of some files of a folder
        shutil.rmtree(place, ignore_errors=True)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.EMLINK, errno.EXDEV):
            raise


def _hand_over(old: Path, target: Path) -> None:
    """Move what `target` does not have from the folder that it replaces, and take that away."""
    with suppress(OSError):
        (target / _UNFINISHED).unlink(missing_ok=True)
    for item in old.iterdir() if old.exists() else ():
        if item.name != _UNFINISHED and not os.path.lexists(target / item.name):
            item.rename(target / item.name)
    shutil.rmtree(old, ignore_errors=True)


def _exchanged(one: Path, other: Path) -> bool:
    """Swap two folders in one step; False where the system has no call for that."""
    swap = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if os.name == "posix" else None
    if swap is None:
        return False
    here = -100  # AT_FDCWD
    if swap(here, os.fsencode(one), here, os.fsencode(other), _EXCHANGE) == 0:
        return True
    if (fault := ctypes.get_errno()) in (errno.EINVAL, errno.ENOSYS):
        return False
    raise OSError(fault, os.strerror(fault), str(other))


def _move_in(temporary: Path, target: Path) -> None:
    """Move the files of a folder into another one, those of the same names out; back again where that fails."""
    (temporary / _UNFINISHED).unlink()
    new = [item.name for item in temporary.iterdir()]
    old = temporary / _UNFINISHED
    (temporary / _PLAN).write_text("\0".join(new), encoding="utf-8")
    old.mkdir()
    try:
        for name in new:
            if os.path.lexists(target / name):
                (target / name).rename(old / name)
        for name in new:
            (temporary / name).rename(target / name)
        old.rename(temporary / "replaced")  # from here on it is done
    except BaseException:
        _move_back(temporary, target)
        raise
    shutil.rmtree(temporary, ignore_errors=True)


def _move_back(temporary: Path, target: Path) -> None:
    """Put back what `_move_in` had taken out."""
    old = temporary / _UNFINISHED
    if old.is_dir():
        for name in (temporary / _PLAN).read_text(encoding="utf-8").split("\0"):
            if os.path.lexists(target / name) and not os.path.lexists(temporary / name):
                (target / name).rename(temporary / name)
        for item in old.iterdir():
            item.rename(target / item.name)
    shutil.rmtree(temporary, ignore_errors=True)


def _locked(folder: Path) -> int | None:
    """Lock a folder for as long as this process lives and keeps the descriptor; None where that cannot be or is done by
    another process."""
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _sweep(target: Path) -> None:
    """Take away what killed runs left half-written, and finish what they left half-moved."""
    named = re.compile(rf"\.{re.escape(target.name)}-[0-9a-f]{{16}}")
    for place in (target.parent, target):
        for left in [item for item in place.iterdir() if named.fullmatch(item.name)] if place.is_dir() else ():
            if left.is_symlink() or not left.is_dir() or (lock := _locked(left)) is None:
                continue
            try:
                if place == target:
                    _move_back(left, target)
                elif (left / _UNFINISHED).exists():
                    shutil.rmtree(left, ignore_errors=True)
                elif target.exists():
                    _hand_over(left, target)
                else:
                    left.rename(target)
            finally:
                os.close(lock)


@contextmanager
def results(folder: str | Path, seed: int | None = None) -> Iterator[Path]:
    """Make a whole folder, in which `run.json` says what the results were made with, as it was when they were begun."""
    made_with = provenance(seed)
    with whole_folder(folder) as temporary:
        yield temporary
        write_provenance(made_with, temporary / "run.json")


def provenance(seed: int | None = None) -> dict[str, Any]:
    """Return what a result was made with: command, seed where numbers were drawn, commit of a checkout, and
    versions."""
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        **({} if seed is None else {"seed": seed}),
        "commit": _commit(),
        "python": platform.python_version(),
        "platform": platform.platform(terse=True),
        "versions": {name: _version(name) for name in _PACKAGES},
    }


def write_provenance(made_with: Mapping[str, Any], path: str | Path) -> None:
    """Write `run.json`."""
    Path(path).write_text(json.dumps(made_with, indent=1) + "\n", encoding="utf-8")


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Commit of the checkout that runs; None for an installed package or where there is no git."""
    if not (_ROOT / ".git").exists():
        return None
    command = ["git", "-C", str(_ROOT), "rev-parse", "--short=12", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
