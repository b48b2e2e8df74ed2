"""Finished work on disk, in an SQLite file that survives Ctrl-C and kill -9, and a fingerprint of the source files."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from casid.errors import InputError

ROOT = Path(__file__).resolve().parent.parent.parent
# what an estimation is computed with
ENGINE = tuple(f"casid/{room}/**/*" for room in ("estimation", "native", "filtering", "analysis", "model", "records"))


def source_digest(*patterns: str) -> str:
    """Fingerprint of the files below the folder of the packages that match the globs, e.g. "casid/model/**/*.py"."""
    digest = hashlib.sha256()
    for path in _files(patterns):
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _files(patterns: Iterable[str]) -> list[Path]:
    return sorted(
        path
        for path in {path for pattern in patterns for path in ROOT.glob(pattern)}
        if path.is_file() and "__pycache__" not in path.parts
    )


FILE = "campaign.sqlite"


class Store:
    """Results by key. Every result is one transaction; a key is written once and never again.

    Only one process works on a store at a time: a second one gets an InputError at once. The lock is the operating
    system's and goes with the process, however that ends.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def finished(self) -> set[str]:
        """Keys of all finished tasks."""
        return {key for (key,) in self._connection.execute("SELECT key FROM results")}

    def put(self, key: str, task: Mapping[str, Any], result: Any, seconds: float) -> None:
        """Keep a result; it is on disk when this returns. Raises InputError for a key that is there already."""
        row = (key, json.dumps(task, sort_keys=True), json.dumps(result, allow_nan=False), seconds)
        try:
            with self._connection:
                self._connection.execute("INSERT INTO results VALUES (?, ?, ?, ?)", row)
        except sqlite3.IntegrityError:
            raise InputError(f"campaign: '{key}' is finished already; it cannot be done twice") from None

    def results(self) -> dict[str, Any]:
        """Key -> result of all finished tasks, sorted by key."""
        rows = self._connection.execute("SELECT key, result FROM results ORDER BY key")
        return {key: json.loads(result) for key, result in rows}

    def seconds(self) -> dict[str, float]:
        """Key -> time that the task took [s]."""
        return dict(self._connection.execute("SELECT key, seconds FROM results ORDER BY key"))


@contextmanager
def open_store(folder: str | Path, protocol: Mapping[str, Any], must_exist: bool = False) -> Iterator[Store]:
    """The store of a folder, made when it is not there.

    protocol     all that results depend on besides their task (sizes, versions): results of another protocol must not
                 be mixed in, so a store that was made under another one is an InputError
    must_exist   InputError when there is nothing to resume
    """
    path = Path(folder) / FILE
    if must_exist and not path.exists():
        raise InputError(f"{path}: nothing to resume; run without --resume, or name the folder of the earlier run")
    made = [place for place in (path, *path.parents) if not place.exists()]  # the deepest first
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path, timeout=0.2)
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"{path}: cannot be opened: {error}; choose another --out") from None
    try:
        _prepare(connection, path, json.dumps(protocol, sort_keys=True))
        store = Store(connection)
        yield store
    except BaseException:
        if made and not (path.exists() and Store(connection).finished()):
            connection.close()
            _take_away(made)
        raise
    finally:
        connection.close()


def read_results(folder: str | Path) -> dict[str, Any]:
    """Key -> result of what is finished in the store of a folder, whatever protocol it was made under. Raises
    InputError for a folder without a store."""
    path = Path(folder) / FILE
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=0.2)) as connection:
            return Store(connection).results()
    except sqlite3.Error as error:
        raise InputError(f"{path}: cannot be read: {error}; name the folder of a campaign") from None


def _take_away(made: list[Path]) -> None:
    """A store in which nothing was finished, and the folders that were made for it."""
    with suppress(OSError):
        made[0].unlink(missing_ok=True)
        for place in made[1:]:
            place.rmdir()


def _prepare(connection: sqlite3.Connection, path: Path, protocol: str) -> None:
    try:
        connection.execute("PRAGMA locking_mode=EXCLUSIVE")
        connection.execute("PRAGMA synchronous=FULL")
        with connection:
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS results (key TEXT PRIMARY KEY, task TEXT, result TEXT, seconds REAL)"
            )
            connection.execute("CREATE TABLE IF NOT EXISTS protocol (text TEXT)")
            found = connection.execute("SELECT text FROM protocol").fetchall()
            if not found:
                connection.execute("INSERT INTO protocol VALUES (?)", (protocol,))
    except sqlite3.OperationalError as error:
        reason = "another run is at work on it" if "locked" in str(error) else str(error)
        raise InputError(f"{path}: {reason}; wait for it, or choose another --out") from None
    except sqlite3.DatabaseError as error:
        raise InputError(f"{path}: is no campaign store ({error}); choose another --out") from None
    if found and found[0][0] != protocol:
        raise InputError(f"{path}: was made by another protocol or version; choose another --out, or delete it")
