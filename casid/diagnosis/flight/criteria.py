"""The numbers by which noise and timing of the records are judged."""

from __future__ import annotations

from dataclasses import dataclass

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class NoiseCriteria:
    """Which channels count as measured, and how strong their noise is."""

    present: float = number(0.1, "part of a record's samples above which a channel counts as measured")
    complete: float = number(0.9, "part of a record's samples above which a channel is read at every sample")
    density_ratio: float = number(1.2, "ratio of noise densities that exceeds the scatter of a high band")
    common_filter: float = number(0.7, "part of the outputs that must show a filter common to all channels")
    smallest: float = number(
        1e-3,
        "smallest noise, over a channel's variation",
        "derived: a noise-free simulation must not have infinite weight",
    )
    band: float = number(
        2.0,
        "factor of the highest frequency of the motion up to which readings of unknown noise count",
        "derived: the octave above it",
    )
    slow: float = number(
        2.0,
        "mean square residual up to which slow residuals are noise of the instrument",
        "derived: slow noise as strong as the measured noise, which is the fast part",
    )
    first: float = number(0.02, "noise of a channel in the first fit, over its variation, if it cannot be measured")
    input_change: float = number(0.1, "relative change of an input's noise above which it counts as limited")
    differentiator: int = number(
        15, "largest number of samples on either side in a filter from rate to angular acceleration"
    )
    differentiated: float = number(
        0.7, "part of the rate's noise after that filter below which the acceleration is computed from the rate"
    )
    smoothed: float = number(0.1, "part of the noise of a rate's differences below which the rate was smoothed before")
    differentiator_samples: int = number(10, "samples per coefficient of that filter")


@dataclass(frozen=True, kw_only=True)
class InputTimingCriteria:
    """Behaviour of recorded inputs between samples: linear, or held over a share of the interval."""

    step: float = number(0.25, "resolution of the share of a sampling interval")
    std: float = number(0.15, "1-sigma of a surface's share above which the surface is not used")
    surfaces: int = number(2, "surfaces that must agree", "derived: one alone may be late for other reasons")
    change: float = number(0.5, "change of the share, beside named causes, that requires another search")
    change_s: float = number(
        0.005, "change of the delay of the inputs that requires another search, if that is less", unit="s"
    )
