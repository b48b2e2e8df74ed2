"""Plain numbers between delimiters, read by blocks: the quick way for large files without gaps or text."""

from __future__ import annotations

import warnings

import numpy as np

_BLOCK = 1 << 23  # bytes
_PLAIN = b"0123456789+-.eE\r\n"


def plain_numbers(raw: bytes, start: int, width: int, delimiter: str) -> np.ndarray | None:
    """(rows, width) numbers of the text from byte `start` on; None where anything but plain numbers stands there.

    Every line must have `width` cells and none may be empty: whoever gets None reads the slow way, which says what is
    wrong and where.
    """
    mark = delimiter.encode()
    end = len(raw)
    while end > start and raw[end - 1] in b"\r\n":
        end -= 1
    values, filled, at = np.empty((raw.count(b"\n", start, end) + 1, width)), 0, start
    while at < end:
        stop = end if at + _BLOCK >= end else raw.rfind(b"\n", at, at + _BLOCK)
        if stop <= at:
            return None
        block = raw[at:stop]
        numbers = _numbers(block, width, mark)
        if numbers is None:
            return None
        values[filled : filled + len(numbers)] = numbers
        filled, at = filled + len(numbers), stop + 1
    return values if filled == len(values) else None


def _numbers(block: bytes, width: int, mark: bytes) -> np.ndarray | None:
    if block.translate(None, _PLAIN + mark):
        return None
    text = np.frombuffer(block, np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    cells = np.searchsorted(np.flatnonzero(text == ord(mark)), ends)
    if (np.diff(cells, prepend=0) != width - 1).any():
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # how older versions of numpy say that text is no number
            numbers = np.fromstring(block.replace(b"\r", b"").replace(b"\n", mark).decode(), sep=mark.decode())
    except (ValueError, DeprecationWarning):
        return None
    return numbers.reshape(-1, width) if numbers.size == width * len(ends) else None
