"""New values in a user's TOML file: its comments, layout and order stay."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, MutableMapping
from typing import Any

import tomlkit

from casid.model.quantities import as_written


def with_comments_of(original: str, content: str) -> str:
    """The TOML text `content`, written into the layout of `original`.

    Keys that both have keep their place and comment, new keys are added to the end of their table, keys that `content`
    lacks are taken away.
    """
    document = tomlkit.parse(original)
    _merge(document, tomllib.loads(content))
    return tomlkit.dumps(document)


def _merge(table: MutableMapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key in [key for key in table if key not in wanted]:
        del table[key]
    for key, value in wanted.items():
        present = table.get(key)
        if isinstance(present, MutableMapping) and isinstance(value, Mapping):
            _merge(present, value)
        elif key not in table or _plain(present) != value:
            table[key] = _in_its_unit(_plain(present), value)


def _in_its_unit(present: Any, value: Any) -> Any:
    """A new value; a number as text in the unit that stands in the file, "6000 lb"."""
    if isinstance(present, str) and isinstance(value, float):
        return as_written(value, present) or value
    return value


def _plain(value: Any) -> Any:
    return value.unwrap() if hasattr(value, "unwrap") else value
