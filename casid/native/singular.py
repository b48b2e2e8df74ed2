"""What linear algebra raises does not reach a user: it is said what it means."""

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
