"""Results kept in files: a line that says what it is, and a pickle.

Pickle, because a result has the whole problem in it, its equations included, and goes on working when it is read again.
The price: such a file is for the casid that wrote it, or one that says it can read it, and like every pickle it may run
code. What is to last, or to be read by others, is `Fit.to_dict`, `Diagnosis.write` and `Aircraft.write`.
"""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path
from typing import Any

from casid.errors import InputError

_MAGIC = "casid.result"
_FORMAT = 1  # goes up when a file of before cannot be read any more


def save(result: Any, path: str | Path) -> None:
    """Write a result whole or not at all. Raises InputError when it cannot be written or holds what cannot be pickled,
    such as a function defined inside another one."""
    kind = type(result).__name__
    try:
        body = pickle.dumps(result, protocol=5)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        fault = str(error).splitlines()[0]
        raise InputError(
            f"{path}: this {kind} cannot be saved: {fault}; define such functions at the top of a module"
        ) from error
    head = {"schema": f"{_MAGIC}/{_FORMAT}", "kind": kind, "casid": sys.modules["casid"].__version__}
    target = Path(path)
    temporary = target.with_name(target.name + ".partial")
    try:
        temporary.write_bytes(json.dumps(head).encode() + b"\n" + body)
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None


def load(path: str | Path) -> Any:
    """The result that `save` wrote. Read only files that you trust: like every pickle they may run code.

    Raises InputError for a file that is none, or of a casid whose results this one cannot read.
    """
    try:
        head, _, body = Path(path).read_bytes().partition(b"\n")
    except (OSError, TypeError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        said = json.loads(head)
        schema = said["schema"]
    except (ValueError, TypeError, KeyError):
        raise InputError(f"{path}: no result of casid; expected a file that fit.save or diagnosis.save wrote") from None
    if schema != f"{_MAGIC}/{_FORMAT}":
        raise InputError(
            f"{path}: of {schema}, this casid reads {_MAGIC}/{_FORMAT}; read it with casid {said.get('casid')}"
        )
    try:
        return pickle.loads(body)
    except Exception as error:  # a damaged pickle raises nearly anything
        fault = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: damaged, or of another casid ({said.get('casid')}): {fault[:120]}") from error
