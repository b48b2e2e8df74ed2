"""Parts of diagnosis.json, and what JSON can hold: it knows neither numpy nor numbers that are not finite."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from casid.diagnosis.cause import Cause
    from casid.diagnosis.evidence.screening import Candidate


def plain(value: Any) -> Any:
    """Numbers and containers that JSON knows; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    number = float(value)
    return number if math.isfinite(number) else None


def cause_entry(cause: Cause) -> dict[str, Any]:
    """An entry of `causes` or `minor`."""
    return {
        "kind": cause.kind,
        "target": cause.target,
        "term": cause.term,
        "value": cause.value,
        "std": cause.std,
        "unit": cause.unit,
        "records": list(cause.records),
        "onset_s": {r: list(i) for r, i in cause.onset_s.items()} if cause.onset_s else None,
        "statistic": cause.statistic,
        "dof": cause.dof,
        "probability": cause.probability,
        "alone": cause.alone,
        "log_odds": cause.log_odds,
        "held_out_gain": cause.held_out_gain,
        "indistinguishable_from": [dict(other) for other in cause.indistinguishable_from],
        "sentence": cause.sentence,
        "parameters": dict(cause.parameters),
        "share": cause.share,
    }


def rank_entry(candidate: Candidate) -> dict[str, Any]:
    """An entry of `ranking`."""
    effect = candidate.attached.effect
    return {
        "kind": effect.kind,
        "target": effect.target,
        "term": effect.term,
        "statistic": candidate.statistic,
        "value": candidate.value,
        "std": candidate.std,
        "surviving": candidate.surviving,
    }
