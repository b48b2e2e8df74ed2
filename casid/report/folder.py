"""Output folders that are whole or not there at all, and what a result was made with."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from casid.errors import InputError

_PACKAGES = ("casid", "casadi", "numpy", "scipy", "matplotlib")
_ROOT = Path(__file__).resolve().parent.parent.parent


_PARTIAL = ".partial-"  # the folder in which a run writes, named by its process: .partial-PID-xxxx


def out_folder(text: str) -> Path:
    """The folder that is called so; "" would silently be the one where the user stands."""
    if not text.strip():
        raise InputError("--out is empty; name a folder for the results, like out")
    return Path(text)


@contextmanager
def whole_folder(folder: str | Path) -> Iterator[Path]:
    """A temporary folder inside `folder`; what was written into it moves up to `folder` when the block ends well.

    Files of the same name are replaced one by one, sub-folders of the same name as a whole; other files in `folder`
    stay. What a killed run left behind is swept away. Raises InputError at once, before any work is done, when nothing
    can be written there or when another run is writing there.
    """
    target = Path(folder)
    made = [place for place in (target, *target.parents) if not place.exists()]  # the deepest first
    try:
        target.mkdir(parents=True, exist_ok=True)
        _sweep(target)
        temporary = Path(tempfile.mkdtemp(prefix=f"{_PARTIAL}{os.getpid()}-", dir=target))
    except OSError as error:
        raise InputError(f"{target}: cannot be written to: {error.strerror or error}; choose another --out") from None
    try:
        yield temporary
        for item in sorted(temporary.iterdir()):
            place = target / item.name
            if item.is_dir() and place.is_dir():
                shutil.rmtree(place)
            item.replace(place)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        for place in made:
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _sweep(target: Path) -> None:
    """Take away what runs that are no more left in the folder; refuse a folder in which one still works."""
    for left in target.glob(f"{_PARTIAL}*"):
        process = left.name.removeprefix(_PARTIAL).split("-")[0]
        if process.isdigit() and int(process) != os.getpid() and _alive(int(process)):
            raise InputError(f"{target}: process {process} is writing its results there; wait, or choose another --out")
        shutil.rmtree(left, ignore_errors=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def provenance(seed: int) -> dict[str, Any]:
    """What a result was made with: command, seed, commit of a checkout, and versions."""
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "seed": seed,
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
