"""Turn an error of linear algebra into one that states what it means for the user."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from casid.errors import EstimationError


@contextmanager
def singular_is(where: str, meaning: str) -> Iterator[None]:
    """A block, or as a decorator a function, whose `numpy.linalg.LinAlgError` becomes an EstimationError: where, and
    what a singular matrix means there."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise EstimationError(f"{where}: {meaning} ({error})") from error
