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


_FLEET = "measured: 95 % of the aircraft that come with JSBSim are within 1.96 of it, at a lift coefficient of 0.4"


@dataclass(frozen=True, kw_only=True)
class DerivativeSizes:
    """1-sigma about zero of the usual derivatives, by `python -m problems.jsbsim.derivative_sizes`.

    Per rad; rates as p b/2V, q c/2V, r b/2V.
    """

    CL_0: float = number(0.32, "of the lift at zero", _FLEET)
    CL_alpha: float = number(3.6, "of the lift by incidence", _FLEET)
    CL_q: float = number(16, "of the lift by q c/2V", _FLEET)
    CL_delta_e: float = number(0.44, "of the lift by the elevator", _FLEET)
    CD_0: float = number(0.056, "of the drag at zero", _FLEET)
    CD_alpha: float = number(0.38, "of the drag by incidence", _FLEET)
    CD_q: float = number(0.97, "of the drag by q c/2V", _FLEET)
    CD_delta_e: float = number(0.041, "of the drag by the elevator", _FLEET)
    CX_0: float = number(0.065, "of the longitudinal force at zero", _FLEET)
    CX_alpha: float = number(0.44, "of the longitudinal force by incidence", _FLEET)
    CX_q: float = number(0.57, "of the longitudinal force by q c/2V", _FLEET)
    CX_delta_e: float = number(0.028, "of the longitudinal force by the elevator", _FLEET)
    CZ_0: float = number(0.32, "of the normal force at zero", _FLEET)
    CZ_alpha: float = number(3.5, "of the normal force by incidence", _FLEET)
    CZ_q: float = number(16, "of the normal force by q c/2V", _FLEET)
    CZ_delta_e: float = number(0.44, "of the normal force by the elevator", _FLEET)
    CY_beta: float = number(0.76, "of the side force by sideslip", _FLEET)
    CY_p: float = number(0.096, "of the side force by p b/2V", _FLEET)
    CY_r: float = number(0.29, "of the side force by r b/2V", _FLEET)
    CY_delta_a: float = number(0.18, "of the side force by the ailerons", _FLEET)
    CY_delta_r: float = number(0.23, "of the side force by the rudder", _FLEET)
    Cl_beta: float = number(0.075, "of the rolling moment by sideslip", _FLEET)
    Cl_p: float = number(0.26, "of the rolling moment by p b/2V", _FLEET)
    Cl_r: float = number(0.11, "of the rolling moment by r b/2V", _FLEET)
    Cl_delta_a: float = number(0.13, "of the rolling moment by the ailerons", _FLEET)
    Cl_delta_r: float = number(0.021, "of the rolling moment by the rudder", _FLEET)
    Cm_0: float = number(0.062, "of the pitching moment at zero", _FLEET)
    Cm_alpha: float = number(1.2, "of the pitching moment by incidence", _FLEET)
    Cm_q: float = number(24, "of the pitching moment by q c/2V", _FLEET)
    Cm_delta_e: float = number(0.79, "of the pitching moment by the elevator", _FLEET)
    Cn_beta: float = number(0.25, "of the yawing moment by sideslip", _FLEET)
    Cn_p: float = number(0.091, "of the yawing moment by p b/2V", _FLEET)
    Cn_r: float = number(0.69, "of the yawing moment by r b/2V", _FLEET)
    Cn_delta_a: float = number(0.021, "of the yawing moment by the ailerons", _FLEET)
    Cn_delta_r: float = number(0.15, "of the yawing moment by the rudder", _FLEET)

    def of(self, derivative: str) -> float | None:
        """By its name, as "CL_alpha"; None of one that is not usual."""
        return getattr(self, derivative, None)
