"""What was computed of a fit is kept with it; its large arrays only while it is one of the fits that were used last."""

from __future__ import annotations

from collections.abc import Hashable
from threading import Lock
from typing import Any
from weakref import ref

from casid.native.processors import available

# Fits with large arrays, the one that was used last at the end. A trial has two, its last point and the next; each
# processor has a trial, and all of them have the model to which the cause is added.
_LAST_USED: list[ref[Kept]] = []
_LOCK = Lock()


class Kept:
    """Values that were computed of one fit, which whoever asks computes again if they are not there.

    small    what is worth its memory as long as the fit lives
    arrays   sensitivities and time histories: most of the size of a fit
    """

    def __init__(self) -> None:
        self.small: dict[Hashable, Any] = {}
        self._arrays: dict[Hashable, Any] = {}

    def __reduce__(self) -> tuple[type[Kept], tuple[()]]:
        """Nothing goes into a file."""
        return Kept, ()

    @property
    def arrays(self) -> dict[Hashable, Any]:
        """The large arrays. Those of the fit that was used longest ago are given up."""
        with _LOCK:
            if not _LAST_USED or _LAST_USED[-1]() is not self:
                _LAST_USED[:] = [one for one in _LAST_USED if one() not in (self, None)]
                _LAST_USED.append(ref(self))
                while len(_LAST_USED) > 1 + 2 * available():
                    if (oldest := _LAST_USED.pop(0)()) is not None:
                        oldest._arrays = {}
            return self._arrays
