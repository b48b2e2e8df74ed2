"""The numbers by which noise and timing of the records are judged."""

from __future__ import annotations

from dataclasses import dataclass

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class NoiseCriteria:
    """Which channels count as measured, and how strong their noise is."""

    present: float = number(0.1, "part of a record's samples above which a channel counts as measured")
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
    far_from_data: float = number(
        100.0,
        "mean square residual of the re-estimated file, over the measured noise, above which the noise is not trusted",
        "chosen: 10 sigmas on average",
    )
    far_from_causes: float = number(
        9.0, "the same with the named causes", "derived: 3 sigmas on average, which no noise leaves"
    )
    slow: float = number(
        2.0,
        "mean square residual up to which slow residuals are noise of the instrument",
        "derived: slow noise as strong as the measured noise, which is the fast part",
    )
    slow_gain: float = number(
        10.0,
        "statistic above which the noise of a channel is slow in part",
        "derived: chi-square 99 % with two numbers free",
        unit="2 ln L",
    )
    slow_sigmas: float = number(
        3.0, "scatter of the variance of a slow part, in 1-sigmas, that is allowed for", "derived: 3 sigmas"
    )
    outlier: float = number(
        5.0,
        "distance of a single innovation from its neighbours, in their scatter, above which it is an outlier",
        "derived: one in 90 flights of 20000 readings by chance",
    )
    outlier_input: float = number(
        4.0, "motion of a surface between samples, in 1-sigmas, near which nothing is an outlier", "derived: 4 sigmas"
    )
    first: float = number(0.02, "noise of a channel in the first fit, over its variation, if it cannot be measured")
    largest_input: float = number(
        3.0, "largest noise of an input, in measured 1-sigmas; more indicates a fault not yet in the model"
    )
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
    agreement: float = number(0.25, "distance of a surface's share from the common one within which they agree")
    surfaces: int = number(2, "surfaces that must agree", "derived: one alone may be late for other reasons")
    gain: float = number(150.0, "statistic of another share", unit="2 ln L")
    change: float = number(0.5, "change of the share, beside named causes, that requires another search")
    change_s: float = number(
        0.005, "change of the delay of the inputs that requires another search, if that is less", unit="s"
    )


_FLEET = "measured: 95 % of the aircraft that come with JSBSim are within 1.96 of it, at a lift coefficient of 0.4"


@dataclass(frozen=True, kw_only=True)
class DerivativeSizes:
    """1-sigma about zero of the usual derivatives, computed by `python -m problems.jsbsim.derivative_sizes`.

    Per rad; rates as p b/2V, q c/2V, r b/2V.
    """

    CL_0: float = number(0.32, "1-sigma of the lift at zero", _FLEET)
    CL_alpha: float = number(3.6, "1-sigma of the lift due to incidence", _FLEET)
    CL_q: float = number(16, "1-sigma of the lift due to q c/2V", _FLEET)
    CL_delta_e: float = number(0.44, "1-sigma of the lift due to the elevator", _FLEET)
    CD_0: float = number(0.056, "1-sigma of the drag at zero", _FLEET)
    CD_alpha: float = number(0.38, "1-sigma of the drag due to incidence", _FLEET)
    CD_q: float = number(0.97, "1-sigma of the drag due to q c/2V", _FLEET)
    CD_delta_e: float = number(0.041, "1-sigma of the drag due to the elevator", _FLEET)
    CX_0: float = number(0.065, "1-sigma of the longitudinal force at zero", _FLEET)
    CX_alpha: float = number(0.44, "1-sigma of the longitudinal force due to incidence", _FLEET)
    CX_q: float = number(0.57, "1-sigma of the longitudinal force due to q c/2V", _FLEET)
    CX_delta_e: float = number(0.028, "1-sigma of the longitudinal force due to the elevator", _FLEET)
    CZ_0: float = number(0.32, "1-sigma of the normal force at zero", _FLEET)
    CZ_alpha: float = number(3.5, "1-sigma of the normal force due to incidence", _FLEET)
    CZ_q: float = number(16, "1-sigma of the normal force due to q c/2V", _FLEET)
    CZ_delta_e: float = number(0.44, "1-sigma of the normal force due to the elevator", _FLEET)
    CY_beta: float = number(0.76, "1-sigma of the side force due to sideslip", _FLEET)
    CY_p: float = number(0.096, "1-sigma of the side force due to p b/2V", _FLEET)
    CY_r: float = number(0.29, "1-sigma of the side force due to r b/2V", _FLEET)
    CY_delta_a: float = number(0.18, "1-sigma of the side force due to the ailerons", _FLEET)
    CY_delta_r: float = number(0.23, "1-sigma of the side force due to the rudder", _FLEET)
    Cl_beta: float = number(0.075, "1-sigma of the rolling moment due to sideslip", _FLEET)
    Cl_p: float = number(0.26, "1-sigma of the rolling moment due to p b/2V", _FLEET)
    Cl_r: float = number(0.11, "1-sigma of the rolling moment due to r b/2V", _FLEET)
    Cl_delta_a: float = number(0.13, "1-sigma of the rolling moment due to the ailerons", _FLEET)
    Cl_delta_r: float = number(0.021, "1-sigma of the rolling moment due to the rudder", _FLEET)
    Cm_0: float = number(0.062, "1-sigma of the pitching moment at zero", _FLEET)
    Cm_alpha: float = number(1.2, "1-sigma of the pitching moment due to incidence", _FLEET)
    Cm_q: float = number(24, "1-sigma of the pitching moment due to q c/2V", _FLEET)
    Cm_delta_e: float = number(0.79, "1-sigma of the pitching moment due to the elevator", _FLEET)
    Cn_beta: float = number(0.25, "1-sigma of the yawing moment due to sideslip", _FLEET)
    Cn_p: float = number(0.091, "1-sigma of the yawing moment due to p b/2V", _FLEET)
    Cn_r: float = number(0.69, "1-sigma of the yawing moment due to r b/2V", _FLEET)
    Cn_delta_a: float = number(0.021, "1-sigma of the yawing moment due to the ailerons", _FLEET)
    Cn_delta_r: float = number(0.15, "1-sigma of the yawing moment due to the rudder", _FLEET)

    def of(self, derivative: str) -> float | None:
        """The size for the name of a derivative, as "CL_alpha"; None for one that is not usual."""
        return getattr(self, derivative, None)
