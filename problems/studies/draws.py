"""A parametric bootstrap as a campaign: every draw a task, so that it resumes and runs on several processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from casid.analysis import replica
from casid.errors import EstimationError
from casid.estimation import Fit, Problem, solve
from casid.model.aircraft import Aircraft
from casid.model.flown_records import default_free, flown_records
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records


def draw_tasks(
    records: Sequence[str],
    aircraft: str,
    draws: int,
    seed: int,
    *,
    free: Sequence[str] = (),
    axes: str | None = None,
    maps: Sequence[str] = (),
    input_noise: Mapping[str, float] | None = None,
) -> dict[str, dict[str, Any]]:
    """Key -> task for `draw`: files by name, so that any process can read them."""
    common = {
        "records": list(records),
        "aircraft": aircraft,
        "free": list(free),
        "axes": axes,
        "maps": list(maps),
        "input_noise": dict(input_noise or {}),
    }
    return {f"draw/{number:05d}": {**common, "seed": [seed, number]} for number in range(draws)}


def draw(task: Mapping[str, Any]) -> dict[str, float] | None:
    """Estimates from one draw; None when it did not converge. The fit itself is made once per process."""
    return replica(fit_of(task), task["seed"], task["input_noise"])


def fit_of(task: Mapping[str, Any]) -> Fit:
    """Output error of the task's records, without a prior. Raises EstimationError when it does not converge."""
    fit = _fit(tuple(task["records"]), task["aircraft"], tuple(task["free"]), task["axes"], tuple(task["maps"]))
    if not fit.converged:
        raise EstimationError(f"the estimation has no result to judge: {fit.status}")
    return fit


@lru_cache(maxsize=1)
def _fit(
    records: tuple[str, ...], aircraft: str, free: tuple[str, ...], axes: str | None, maps: tuple[str, ...]
) -> Fit:
    flown = read_records(list(records), ColumnMap.from_options(list(maps)))
    applied = flown_records(Aircraft.read(aircraft), flown, axes)
    globs = list(free) or list(default_free(applied))
    biases = [glob for glob in globs if glob.startswith("bias_")]
    shared = [glob for glob in globs if glob not in biases]
    return solve(Problem(applied.model, applied.records, free=shared, per_record=biases))
