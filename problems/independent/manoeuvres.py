"""What the pilot does: deviations of the controls from trim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CONTROLS = ("delta_e", "delta_a", "delta_r", "throttle")
EDGE_S = 0.12  # time that a hand takes from one position to the next


@dataclass(frozen=True, kw_only=True)
class Move:
    """Steps of one control: from `start` [s], positions in units of its size, each held for its number of units."""

    control: str
    start: float
    steps: Sequence[tuple[float, float]]


# shapes: positions in units of a control's size, each held for its number of units of time
_SHAPES = {
    "3211": ((1.0, 3.0), (-1.0, 2.0), (1.0, 1.0), (-1.0, 1.0)),
    "doublet": ((1.0, 1.0), (-1.0, 1.0)),
    "step": ((1.0, 1.0),),
}
# record -> moves in their order: control, shape, sign. The last record is held back. Ailerons come last, because an
# aileron that does not return to zero rolls the aircraft until the end.
CARDS = {
    "m1": (("delta_e", "3211", 1), ("throttle", "step", 1), ("delta_a", "doublet", 1)),
    "m2": (("delta_r", "doublet", 1), ("delta_e", "doublet", -1), ("throttle", "step", -1), ("delta_a", "doublet", 1)),
    "m3": (("delta_r", "doublet", -1), ("delta_e", "3211", -1), ("delta_a", "doublet", 1)),
    "m4": (("throttle", "step", -1), ("delta_e", "doublet", 1), ("delta_r", "doublet", 1), ("delta_a", "doublet", -1)),
    "m5": (("delta_e", "3211", 1), ("delta_r", "doublet", 1), ("throttle", "step", 1), ("delta_a", "doublet", -1)),
}


def flown(card: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
    """The moves of a card, spread over a record and scattered as a pilot does."""
    slot = (duration_s - 2.5) / len(CARDS[card])
    moves = []
    for k, (control, shape, sign) in enumerate(CARDS[card]):
        scatter = rng.uniform(0.9, 1.1, len(_SHAPES[shape]))
        steps = tuple((sign * place * s, units) for (place, units), s in zip(_SHAPES[shape], scatter, strict=True))
        moves.append(Move(control=control, start=1.5 + slot * k + rng.uniform(0.0, 0.8), steps=steps))
    return moves


def history(t: np.ndarray, moves: Sequence[Move], control: str, size: float, unit_s: float) -> np.ndarray:
    """(N,) deviation of one control along t [s], with straight edges of EDGE_S."""
    deviation = np.zeros_like(t)
    for move in moves:
        if move.control != control:
            continue
        times, places, now = [move.start], [0.0], move.start
        for place, units in move.steps:
            times += [now + EDGE_S, now + units * unit_s]
            places += [place, place]
            now += units * unit_s
        deviation += np.interp(t, [*times, now + EDGE_S], [*places, 0.0])
    return size * deviation
