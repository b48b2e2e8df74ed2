"""Translate the columns of programs whose names are their own, as `loggers.toml` lists them.

A user's map has priority.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from functools import cache
from importlib.resources import files
from typing import Any

from casid.records.column_map import ColumnMap


@cache
def _loggers() -> list[dict[str, Any]]:
    """Name, signs and columns of each program."""
    return tomllib.loads(files("casid.records").joinpath("loggers.toml").read_text(encoding="utf-8"))["logger"]


def logger_of(names: Collection[str]) -> tuple[str, ColumnMap] | None:
    """Name of the program that wrote columns of these names, and the map of those that it has; None for another."""
    there = set(names)
    for logger in _loggers():
        if not there.issuperset(logger["signs"]):
            continue
        columns = {}
        for channel, several in logger["columns"].items():
            for column in [several] if isinstance(several, str) else several:
                one = ColumnMap.of({channel: column}).columns
                if one[channel][0].column in there:
                    columns |= one
                    break
        return logger["name"], ColumnMap(columns=columns)
    return None
