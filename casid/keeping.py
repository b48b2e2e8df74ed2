"""Keep results in files: a line that states what it is, and a pickle.

Pickle, because a result has the whole problem in it, its equations included, and works when it is read again.
The price: such a file is for the casid that wrote it, or one that states that it can read it, and like every pickle it
may run code. What is to last, or to be read by others, is `Fit.to_dict`, `Diagnosis.write` and `Aircraft.write`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import pickle
import secrets
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from casid.arguments import a_path
from casid.errors import InputError

_MAGIC = "casid.result"
_FORMAT = 3  # goes up when a file of before cannot be read any more


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to be written, which takes its place and mode when the block ends well. Its name is random,
    and a link is replaced, not followed. Raises InputError when it cannot be written, as where the disk is full."""
    target = Path(path)
    temporary = target.with_name(f".{secrets.token_hex(8)}-{target.name}")
    try:
        if target.is_file() and not target.is_symlink():
            mode = stat.S_IMODE(target.stat().st_mode)
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
            temporary.chmod(mode)
        yield temporary
        temporary.replace(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def by_fields(self: Any) -> dict[str, Any]:
    """Numbers, texts, lists and tables by name, for JSON; None for a number that is not finite."""
    return plain(self, getattr(self, "in_json", "") or " ".join(f.name for f in fields(self)))


def plain(value: Any, names: str = "") -> Any:
    """Numbers, texts, lists and tables for JSON; None for a number that is not finite.

    Of a result its `names`, as "name value from=before" where one has another name in JSON. Without names, what its
    `to_dict` gives, or its fields, or those that its class has in `in_json`.
    """
    if names:
        pairs = ((key, name or key) for key, _, name in (one.partition("=") for one in names.split()))
        return {key: plain(getattr(value, name)) for key, name in pairs}
    if is_dataclass(value):
        own = getattr(value, "to_dict", None)
        return by_fields(value) if own is None else plain(own())
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    if hasattr(value, "tolist"):  # of numpy
        return plain(value.tolist())
    return float(value) if math.isfinite(value) else None


def save(result: Any, path: str | Path) -> None:
    """Write a result whole or not at all. Raises InputError when it cannot be written or holds what cannot be pickled,
    such as a function defined inside another one."""
    kind = type(result).__name__
    target = a_path(path, "save")
    try:
        body = pickle.dumps(result, protocol=5)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        fault = str(error).splitlines()[0]
        raise InputError(
            f"{path}: this {kind} cannot be saved: {fault}; define such functions at the top of a module"
        ) from error
    head = {"schema": f"{_MAGIC}/{_FORMAT}", "kind": kind, "casid": sys.modules["casid"].__version__}
    head["sha256"] = hashlib.sha256(body).hexdigest()
    with whole_file(target) as temporary:
        temporary.write_bytes(json.dumps(head).encode() + b"\n" + body)


def load(path: str | Path) -> Any:
    """The result that `save` wrote. Read only files that you trust: like every pickle they may run code.

    Parameters
    ----------
    path
        The file that `fit.save`, `diagnosis.save` or another `save` wrote.

    Returns
    -------
    object
        The result, of the class that was saved: a `Fit`, a `Diagnosis`, ...

    Raises
    ------
    InputError
        For a file that is none, that is damaged, or that was written by a casid whose results this one cannot read.

    Examples
    --------
    >>> import casid as cs
    >>> fit.save("short_period.fit")  # doctest: +SKIP
    >>> again = cs.load("short_period.fit")  # doctest: +SKIP
    >>> cs.load("pyproject.toml")
    Traceback (most recent call last):
    casid.errors.InputError: pyproject.toml: no result of casid; expected a file that fit.save or diagnosis.save wrote
    """
    try:
        file = Path(path)
        if file.exists() and not file.is_file():
            raise InputError(f"{path}: cannot be read: is {'a folder' if file.is_dir() else 'no file but a device'}")
        head, _, body = file.read_bytes().partition(b"\n")
    except (OSError, TypeError, ValueError) as error:
        raise InputError(f"{str(path)[:200]}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        said = json.loads(head)
        schema = said["schema"]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError(f"{path}: no result of casid; expected a file that fit.save or diagnosis.save wrote") from None
    if schema != f"{_MAGIC}/{_FORMAT}":
        raise InputError(
            f"{path}: of {schema}, this casid reads {_MAGIC}/{_FORMAT}; read it with casid {said.get('casid')}"
        )
    whole = hashlib.sha256(body).hexdigest()
    if said.get("sha256", whole) != whole:  # of what is damaged, pickle may end this process
        raise InputError(f"{path}: damaged: its content is not what was written; save the result again")
    try:
        return pickle.loads(body)
    except Exception as error:  # a damaged pickle raises nearly anything
        fault = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: damaged, or of another casid ({said.get('casid')}): {fault[:120]}") from error
