"""The numbers by which noise and timing of the records are judged."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.criterion import number


@dataclass(frozen=True, kw_only=True)
class NoiseCriteria:
    """Which channels count as measured, and how strong their noise is taken to be."""

    present: float = number(0.1, "part of a record's samples above which a channel counts as measured")
    density_ratio: float = number(1.2, "ratio of noise densities that is more than the scatter of a high band")
    common_filter: float = number(0.7, "part of the outputs in which a filter common to all channels shows")
    smallest: float = number(
        1e-3, "smallest noise, of a channel's variation", "derived: a noise-free simulation must not weigh infinitely"
    )
    band: float = number(
        2.0, "times the end of the motion up to which readings of unknown noise count", "derived: the octave above it"
    )
    far_from_data: float = number(
        100.0,
        "squares left per reading by the file refitted, in the noise as read, from which that is not believed",
        "chosen: 10 sigmas on average",
    )
    far_from_causes: float = number(
        9.0, "the same of what named causes leave", "derived: 3 sigmas on average, which no noise leaves"
    )
    slow: float = number(
        2.0,
        "squares left per reading up to which what moves slowly is the instrument's noise",
        "derived: as much again as the noise that was read, which is its quick part",
    )
    slow_gain: float = number(
        10.0,
        "gain from which a channel's noise is slow in part",
        "derived: chi-square 99 % with two numbers free",
        unit="2 ln L",
    )
    slow_sigmas: float = number(
        3.0, "scatter of a slow part's variance, in 1-sigmas, by which it may seem to be more", "derived: 3 sigmas"
    )
    outlier: float = number(
        5.0,
        "scatters by which a single innovation is off those beside it, from which it is no noise",
        "derived: one in 90 flights of 20000 readings by chance",
    )
    outlier_input: float = number(
        4.0, "1-sigmas by which a surface moves between samples, near which nothing is an outlier", "derived: 4 sigmas"
    )
    first: float = number(0.02, "noise of a channel in the first fit, of its variation, when it hides its noise")
    largest_input: float = number(
        3.0, "1-sigmas of an input's noise; what would need more is a fault that the model does not have yet"
    )
    input_change: float = number(0.1, "relative change of an input's noise above which it counts as held back")
    differentiator: int = number(15, "samples on either side that a filter may use to make an acceleration of a rate")
    differentiated: float = number(0.7, "part of the rate's noise behind that filter, below which it is made of it")
    smoothed: float = number(0.1, "part of the noise of a rate's differences below which it is made of smoothed ones")
    differentiator_samples: int = number(10, "samples per coefficient of that filter")


@dataclass(frozen=True, kw_only=True)
class InputTimingCriteria:
    """How recorded inputs run between samples: linearly, or held over a share of the interval."""

    step: float = number(0.25, "resolution of the share of a sampling interval")
    std: float = number(0.15, "1-sigma of a surface's share, above which it does not tell")
    agreement: float = number(0.25, "distance of a surface's share from that on which the surfaces agree")
    surfaces: int = number(2, "surfaces that must agree", "derived: one alone may be late for other reasons")
    gain: float = number(150.0, "gain of another share", unit="2 ln L")
    change: float = number(0.5, "change of the share, beside named causes, that is worth another naming")
    change_s: float = number(0.005, "change of how late inputs come that is worth it, if that is less", unit="s")
