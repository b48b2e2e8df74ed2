"""Tables in binary files: MATLAB .mat, numpy .npz, and .parquet where pyarrow is installed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import read_hdf5
from casid.records.named_arrays import loaded, table_of
from casid.records.table import RawTable


def read_mat(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .mat file: its one matrix, without names, or one vector per channel, also as fields of a struct.

    scipy reads it; with some forged flags in the header scipy itself crashes, so that no error can be raised.
    """
    from scipy.io import loadmat  # here, because few records are .mat and scipy.io is slow to import

    try:
        content = loaded(path, lambda: loadmat(str(path)))
    except NotImplementedError:  # version 7.3 is HDF5
        return read_hdf5(path, variable, time)
    return table_of(path, {k: v for k, v in content.items() if not k.startswith("__")}, variable, time)


def read_npz(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .npz file: its one matrix, without names, or one vector per channel. Pickled objects are refused."""

    def load() -> dict[str, Any]:
        # opened here: numpy leaves a damaged file open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive)

    return table_of(path, loaded(path, load), variable, time)


def read_parquet(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .parquet file; needs the extra `parquet`."""
    try:
        parquet = import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            f"{path}: reading .parquet needs pyarrow; install it with: pip install 'casid[parquet]', or save as CSV"
        ) from None

    def load() -> dict[str, Any]:
        content = parquet.read_table(path)
        return {name: content.column(name).to_numpy() for name in content.column_names}

    return table_of(path, loaded(path, load), variable, time)
