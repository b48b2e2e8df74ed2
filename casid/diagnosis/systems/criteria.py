"""Criteria for systems other than aircraft, in addition to those of the engine, and the extent of the search."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.criterion import number


@dataclass(frozen=True, kw_only=True)
class SystemCriteria:
    """Which causes of a system are tried, and how widely."""

    record: float = number(
        26.0,
        "length of a record for which all numbers in seconds are meant; those of a system are longer or shorter with "
        "its records",
        "measured: the records of aircraft by which these were set",
    )
    smallest_noise: float = number(
        1e-4, "smallest noise, of a channel's variation", "derived: a noise-free simulation must not weigh infinitely"
    )
    seen: float = number(0.01, "r.m.s. change by an operator, of the variation, from which its size is tried")
    whole: float = number(1.2, "the same, beyond which nothing of the signal is left")
    wholly: float = number(
        0.5, "part of the motion of a reading within which one that is stuck has lost all of it", "derived: half"
    )
    cuts: tuple[float, ...] = number((0.03, 0.06, 0.12, 0.25, 0.5), "sizes of what cuts an input, of its range")
    smoothed: int = number(8, "times that a motion is smoothed about itself")
    trials: int = number(8, "causes of the first ranking that are fitted in a round, which costs little")
    further_trials: int = number(4, "causes of each other ranking")
    terms: int = number(5, "terms of one equation among them")
    iterations: int = number(25, "iterations of such a fit, at most")
    give_up: float = number(1e6, "part of the best gain behind it at which a trial is given up: none is")
