"""What decides about a system that is no aircraft, and how far its search looks: every number with its evidence."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.criterion import number


@dataclass(frozen=True, kw_only=True)
class SystemCriteria:
    """Which causes of a system are tried, when they have settled, and how finely histories are made."""

    unexplained: float = number(
        0.5, "probability from which something unknown is told", "derived: to look where nothing is costs little"
    )
    smallest_noise: float = number(
        1e-4, "smallest noise, of a channel's variation", "derived: a noise-free simulation must not weigh infinitely"
    )
    shortest_lag: float = number(0.5, "samples of the quickest lag", "derived: the integrator follows no quicker one")
    seen: float = number(0.01, "r.m.s. change by an operator, of the variation, from which its size is tried")
    whole: float = number(1.2, "the same, beyond which nothing of the signal is left")
    cuts: tuple[float, ...] = number((0.03, 0.06, 0.12, 0.25, 0.5), "sizes of what cuts an input, of its range")
    limit_spread: float = number(0.1, "1-sigma about the size of a limit, of the range of its input")
    near: float = number(0.35, "1-sigma about a value of a grid", "derived: half of a factor of two to its neighbours")
    onsets: int = number(12, "times in a record at which something may begin")
    nodes: int = number(40, "intervals of an unknown history in a record")
    times: tuple[float, ...] = number((0.02, 0.075, 0.3), "correlation times of it, of the length of a record")
    base: tuple[float, ...] = number(
        (0.0, 0.02),
        "levels of histories at all ports at once, in units of what matters, with equal odds",
        "measured: with higher ones a voltage that wanders was told as two changed parameters",
    )
    most: int = number(4, "causes of a whole")
    tried: int = number(3, "causes of each ranking that are put into the model in a round")
    member: float = number(0.005, "probability from which a rival is a member of a set")
    worth: float = number(0.02, "probability from which a cause is tried")
    pool: int = number(30, "columns of each ranking that a search of causes in company takes")
    worse: float = number(
        10.0, "cost that a fit may lie behind the one without its cause; beyond, it ended elsewhere", unit="ln L"
    )
    promise: float = number(
        -3.0, "log odds by a linearisation from which a cause is tried", "derived: 20 to 1 against it", signed=True
    )
    settled: float = number(0.02, "relative change of a value below which an operator or an onset has settled")
    still: float = number(0.1, "change of what is left of a delayed reading, of the noise, below which it has settled")
    rounds: int = number(8, "fits until operators and onsets have settled, at most")
    factor: float = number(3.0, "by which a value of an operator may move in a round")
    smoothed: int = number(8, "times that a motion is smoothed about itself")
    slope: float = number(0.02, "part of its value over which the slope of an operator is taken")
