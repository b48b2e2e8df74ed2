"""The table of a binary file from the named arrays that are in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError, unknown
from casid.records.table import RawTable


def loaded(path: Path, load: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `load` returns; whatever it raises becomes an InputError."""
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        return load()
    except NotImplementedError:
        raise
    except Exception as error:  # a damaged file makes these libraries raise some twenty unrelated types
        fault = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: not a readable {path.suffix} file: {fault[:120]}") from None


def table_of(path: Path, arrays: Mapping[str, Any], variable: str | None, time: str) -> RawTable:
    """The table of named arrays: its one matrix, or one vector per channel; fields of structs count as arrays."""
    arrays = dict(_fields(arrays))
    numeric = {k: v for k, v in arrays.items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiub" and v.size > 1}
    if variable is not None:
        if variable not in numeric:
            raise unknown("variable", variable, numeric, str(path))
        numeric = {variable: numeric[variable]}
    vectors = {name: v.ravel() for name, v in numeric.items() if max(v.shape) == v.size}
    matrices = {name: v for name, v in numeric.items() if v.ndim == 2 and name not in vectors}
    if vectors and (time in vectors or not matrices):
        return _vectors(path, vectors, time)
    if len(matrices) != 1:
        held = ", ".join(matrices) or "none"
        raise InputError(
            f"{path}: expected one matrix, or one vector per channel with '{time}' among them; matrices in the file: "
            f"{held}; name one as 'variable' in a column map"
        )
    name, matrix = next(iter(matrices.items()))
    if matrix.shape[0] < matrix.shape[1]:
        raise InputError(f"{path}: '{name}' has shape {matrix.shape}; expected samples in rows: transpose it")
    return RawTable(source=str(path), names=None, values=matrix.astype(float))


def _fields(arrays: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Arrays by name, structs of MATLAB taken apart."""
    for name, value in arrays.items():
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            yield from _fields({field: value.reshape(-1)[0][field] for field in value.dtype.names})
        else:
            yield name, value


def _vectors(path: Path, vectors: Mapping[str, np.ndarray], time: str) -> RawTable:
    reference = time if time in vectors else next(iter(vectors))
    for name, values in vectors.items():
        if len(values) != len(vectors[reference]):
            raise InputError(
                f"{path}: variable '{name}' has {len(values)} samples, '{reference}' has {len(vectors[reference])}; "
                "all channels need the same"
            )
    values = np.stack([v.astype(float) for v in vectors.values()], axis=1)
    return RawTable(source=str(path), names=tuple(vectors), values=values)
