"""Names by which loggers call the time, and the units that stand in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

# names without signs between the letters; the likeliest first
_TIMES = ("t", "time", "timestamp", "elapsedtime", "reltime", "relativetime", "timeelapsed", "elapsed")
_TIMES += ("timestampsample", "irigtime", "irig", "utctime", "utc", "gpstime", "lcltime", "localtime")
_TIMES += ("datetime", "datetimeutc", "zeit", "zeitstempel", "uhrzeit", "tempo", "temps", "tod", "offsettime")
_TIMES += ("sessiontime", "systemtime", "timestartup", "sampletimefine", "xvalue", "timeutc")
_TIMES += ("timeboot", "timesinceboot", "timesincestart", "uptime", "simtime")
_ENDS = {"nsec": "ns", "usec": "us", "msec": "ms", "seconds": "s", "secs": "s", "sec": "s"}
_ENDS |= {"us": "us", "ms": "ms", "ns": "ns", "s": "s"}


def time_named(name: str) -> tuple[int, str] | None:
    """Return how unlikely a name is that of the time, from 0, and the unit in it, "us" of `TimeUS`; None for another
    name."""
    plain = re.sub(r"[\W_]", "", name).lower()
    if plain in _TIMES:
        return _TIMES.index(plain), ""
    for end, unit in _ENDS.items():
        stem = plain.removesuffix(end)
        if stem != plain and stem in _TIMES[1:]:
            return len(_TIMES) + _TIMES.index(stem), unit
    return None


def time_column(names: Sequence[str], among: Iterable[int]) -> int | None:
    """The column that is called as loggers call time, the likeliest name first; None where there is none."""
    found = [(known[0], i) for i in among if (known := time_named(names[i])) is not None]
    return min(found)[1] if found else None
