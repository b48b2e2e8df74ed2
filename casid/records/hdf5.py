"""HDF5: datasets of all groups under their paths, with the units, scales and marks of missing samples they carry."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from casid.records.foreign import library, loaded
from casid.records.items import Item, fields_of, item_of, table_of
from casid.records.table import RawTable

_DEEPEST = 20  # groups within groups


def read_hdf5(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an HDF5 file: one vector per channel, in groups or not, or one matrix; needs the extra `hdf5`."""
    h5py = library("h5py", path, "hdf5")

    def load() -> list[Item]:
        with h5py.File(path, "r") as file:
            return list(_items(h5py, file, "", frozenset()))

    return table_of(path, loaded(path, load), variable, time)


def _items(h5py: Any, group: Any, above: str, within: frozenset[int]) -> Iterator[Item]:
    """All datasets at and below a group. `within`: addresses of the groups that it stands in, to which a link may lead
    back."""
    for name in group:
        path = f"{above}/{name}"
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            yield Item(path=path, name=name, why="a link to another file; copy it into this one")
            continue
        item = group.get(name)
        if item is None:
            yield Item(path=path, name=name, why="a link to nothing")
        elif isinstance(item, h5py.Group):
            address = h5py.h5o.get_info(item.id).addr
            if address not in within and len(within) < _DEEPEST:
                yield from _items(h5py, item, path, within | {address})
        elif isinstance(item, h5py.Dataset):
            yield from _of_dataset(h5py, item, path, name)
        else:
            yield Item(path=path, name=name, why="a type, no data")


def _of_dataset(h5py: Any, item: Any, path: str, name: str) -> Iterator[Item]:
    """A dataset, or the columns of one of structures."""
    if item.external or item.is_virtual:
        yield Item(path=path, name=name, why="in another file; copy it into this one")
    elif h5py.check_string_dtype(item.dtype) is not None:
        yield Item(path=path, name=name, why="text")
    elif h5py.check_ref_dtype(item.dtype) is not None:
        yield Item(path=path, name=name, why="references, such as the cells of MATLAB")
    elif item.shape is None:
        yield Item(path=path, name=name, why="empty")
    else:
        values = np.asarray(item)
        if values.dtype.names:
            yield from (item_of(inner, leaf, part) for inner, leaf, part in fields_of(values, path, "/"))
        else:
            yield item_of(path, name, values, dict(item.attrs))
