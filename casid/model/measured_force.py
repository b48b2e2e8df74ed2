"""A measured external force of a record, as of a tether, a tow, a sling or a hook, as inputs of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from casid.model.vectors import cross
from casid.records.record import Record
from casid.signals import EXTERNAL_FORCE, FORCE_POINT


def external_force(inputs: Mapping[str, Any]) -> tuple[list[Any], list[Any]]:
    """Measured force of a tether, a tow or a load [N] and its moment about the reference point [N m], in body axes;
    zero where the inputs have none."""
    force = [inputs.get(name, 0.0) for name in EXTERNAL_FORCE]
    return force, cross([inputs.get(name, 0.0) for name in FORCE_POINT], force)


def force_inputs(records: Iterable[Record]) -> tuple[str, ...]:
    """The inputs by which a model has a measured external force and its point; none where no record has a force."""
    pulled = any(name in record for record in records for name in EXTERNAL_FORCE)
    return (*EXTERNAL_FORCE, *FORCE_POINT) if pulled else ()


def pulled_alike(records: Iterable[Record], beside: Iterable[Record] = ()) -> list[Record]:
    """Records with the inputs of an external force, zero where they lack it, if one of them or of `beside` has one."""
    records = list(records)
    wanted = force_inputs([*records, *beside])
    return [r.with_channels(**{name: np.zeros(len(r)) for name in wanted if name not in r}) for r in records]
