"""The budget of the error: what each step from the file as given to the best model is worth, channel by channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from casid.diagnosis.given.budget import Budget, BudgetSteps
from casid.report import looks
from casid.report.figure import Axis, Bar, Figure, Note, Panel, Picture, Rule
from casid.report.svg import shown

# what is taken away between one step and the next, in the order of the waterfall
_DROPS: Mapping[looks.Look, tuple[str, str]] = {
    looks.Look(name="data", colour=looks.YELLOW): ("as_given", "data_mended"),
    looks.Look(name="values of the file", colour=looks.ORANGE): ("data_mended", "values"),
    looks.Look(name="structure (causes)", colour=looks.BLUE): ("values", "structure"),
    looks.Look(name="unexplained", colour=looks.FAINT): ("structure", "noise"),
}
_WORSE = looks.Look(name="a step that makes it worse", colour="#FFFFFF", edge=looks.PINK, hatch="////")
# height of a bar in rows, and of a row in inches
_BAR = 0.21
_ROW = 0.42
_LEAST = 0.02  # relative change that is drawn
_MOST = 1e4  # times the noise: a simulation that diverges ends there


def plot(found: Budget) -> Any:
    """Return the picture of the budget for a notebook."""
    return shown(budget(found).figure)


def budget(found: Budget) -> Picture:
    """Return a waterfall per channel on a common logarithmic axis, all channels on top, then the worst as given."""
    order = sorted(found.channels, key=lambda o: -_size(found.channels[o].as_given))
    rows = {"all channels": found.together} | {_row_name(found, o): found.channels[o] for o in order}
    bars = [part for y, steps in enumerate(rows.values()) for part in _waterfall(y, steps)]
    left = [_size(steps.structure) for steps in rows.values()]
    panel = Panel(
        parts=(
            *bars,
            Rule(look=looks.LIMIT.called("noise alone"), at=1.0),
            Rule(look=looks.ZERO, at=0.5, axis="y"),
        ),
        x=Axis(
            label="r.m.s. error / noise (log scale)",
            log=True,
            low=min(0.6, 0.9 * max(min(left), 1e-3)),
            high=2.2 * max(*(_size(steps.as_given) for steps in rows.values()), *left, 2.0),
        ),
        y=Axis(names=tuple(rows), bold=frozenset({0})),
        height=_ROW * len(rows),
    )
    names = ", ".join(found.records)
    together = found.together
    return Picture(
        name="budget",
        figure=Figure(rows=((panel,),)),
        title=f"From the simulation as given to the noise, on {names} (held out)",
        caption="Each bar is the part of the error that one step removes: correcting the data, re-estimating the "
        "values of the file, adding the named causes. Grey is unexplained. The number is the error as given.",
        alt=f"Waterfall of the error per channel over the noise. All channels: {together.as_given:.3g} as given, "
        f"{together.data_mended:.3g} with the data corrected, {together.values:.3g} with values re-estimated, "
        f"{together.structure:.3g} with causes; worst as given: {order[0]}.",
    )


def _row_name(found: Budget, channel: str) -> str:
    label = found.labels.get(channel, channel)
    return channel if label == channel else f"{label} {channel}"


def _waterfall(y: int, steps: BudgetSteps) -> Iterator[Bar | Note]:
    """Yield the four bars of a row, one below the other, and the error as given in figures."""
    for i, (look, (before, after)) in enumerate(_DROPS.items()):
        high = _size(getattr(steps, before))
        low = _size(getattr(steps, after))
        if abs(high / low - 1.0) < _LEAST:
            continue
        worse = low > high
        if look.colour == looks.FAINT and worse:
            continue  # a residual below the noise that was assumed: nothing is left
        ends = {"low": min(high, low), "high": max(high, low), "height": 0.9 * _BAR}
        yield Bar(look=_WORSE if worse else look, at=y + _BAR * (i - 1.5), **ends)
    told = f"{steps.as_given:.3g}" if np.isfinite(steps.as_given) and steps.as_given < _MOST else "diverges"
    right = max(_size(s) for s in (steps.as_given, steps.values, steps.structure, 1.0))
    yield Note(text=told, x=right, y=float(y), offset=(5.0, 0.0))


def _size(value: float) -> float:
    """Return a size as it is drawn."""
    return float(min(value, _MOST)) if np.isfinite(value) else _MOST
