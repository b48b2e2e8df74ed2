"""Every number by which a diagnosis decides, with its value, its meaning and its evidence.

A statistic is a likelihood-ratio statistic, 2 ln L: for white Gaussian noise it is about chi-square distributed if the
cause is absent. A number without better evidence is marked as "chosen". All of these that no gate names, moved at once
by a factor of 1.4, left verdict and names of 86 of 88 blind sets as they were (problems/blind/ablation.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.criterion import Criterion, Value, listed, number, overridden
from casid.data_check.criteria import DataCriteria
from casid.diagnosis.numerics import Numerics, ProbabilityNumerics
from casid.diagnosis.rotor_criteria import RotorCriteria
from casid.model.library import SystemCriteria
from casid.records.limits import read_toml

_GAIN = "2 ln L"


@dataclass(frozen=True, kw_only=True)
class SignificanceCriteria:
    """Likelihood-ratio statistics that noise alone does not reach."""

    chance: float = number(9.0, "statistic of one number that is significant", "derived: 3 sigmas, 0.3 %", unit=_GAIN)
    search: float = number(
        31.4,
        "statistic of the best of many candidates that is significant",
        "derived: 5.6 sigmas, power 90 %, false alarm 1e-4 over a hundred candidates",
        unit=_GAIN,
    )

    @property
    def sigmas(self) -> float:
        """Distance from zero, in 1-sigmas, of one number that is significant."""
        return self.chance**0.5

    @property
    def detectable(self) -> float:
        """Smallest detectable size, in 1-sigmas."""
        return self.search**0.5


@dataclass(frozen=True, kw_only=True)
class PartCriteria:
    """Parts of a whole, by which comparisons without a number of their own are made."""

    third: float = number(
        1 / 3,
        "part of a statistic, or of a size, below which a cause is not worth a fit, and the kinematics reject it; what "
        "it leaves is most of something: part of a cause's statistic above which another is an alternative, short of "
        "which a trial is abandoned, and that kinematics confirm; of turbulence's statistic that slow latent inputs "
        "reach, which coloured noise cannot; of outputs that show a filter common to all; of a rate's noise below "
        "which its derivative was computed from it; of a value's information that one stretch is given at most; sine "
        "of the angle of similar fingerprints",
        "measured: 0.3 and 0.6 to 0.8 before, verdict and names the same in 35 of 36 sets",
    )
    half: float = number(
        0.5,
        "part of the information on a number by the records that is more than the file's own; of a predicted size that "
        "a fit may find; of the noise of a reading's high band below which it is not sought; delay of a surface in "
        "sampling intervals, and change in 1-sigmas, from which they matter; and lowest Oswald factor of a wing",
        "derived: the larger part",
    )
    quarter: float = number(
        0.25,
        "part of a latent input's statistic that may remain beside a cause; of a sampling interval to which the timing "
        "of inputs is resolved; motion of an axis, over that of the other, below which it is out of scope; of a "
        "reading's variation that may be noise; predicted decrease of a step, over that before, that is progress",
        "measured: causes leave hardly any, imitations a fifth, the same decisions up to 0.32 on 86 sets; records of "
        "one axis move the other by 0.03 to 0.21",
    )
    tenth: float = number(
        0.1,
        "part of a latent input's statistic that may remain beside a term or a configuration change, which can imitate "
        "others; of turbulence's statistic that a single axis must leave unexplained, as air moves along all; relative "
        "error of its velocity, as a first-order process only approximates a Dryden spectrum",
        "measured: imitations left 0.12; the same decisions from 0.099 to 0.318 on 86 sets",
    )

    @property
    def most(self) -> float:
        """What a third leaves."""
        return 1.0 - self.third


@dataclass(frozen=True, kw_only=True)
class NoiseCriteria:
    """Which channels count as measured, and how strong their noise is."""

    present: float = number(
        0.1,
        "part of a record's samples above which a channel counts as measured, and short of which it is read at all",
    )
    density_ratio: float = number(
        1.2,
        "ratio of two noise densities that exceeds the scatter of a high band, or at which inputs have other noise",
    )
    smallest: float = number(
        1e-3,
        "smallest noise, over a channel's variation",
        "derived: a noise-free simulation must not have infinite weight",
    )
    slow: float = number(
        2.0,
        "mean square residual up to which slow residuals are noise of the instrument",
        "derived: slow noise as strong as the measured noise, which is the fast part",
    )
    differentiator: int = number(
        15, "largest number of samples on either side in a filter from rate to angular acceleration"
    )


@dataclass(frozen=True, kw_only=True)
class PriorCriteria:
    """Prior uncertainty of derivatives."""

    spread: float = number(
        3.0,
        "prior 1-sigma of a derivative without a stated uncertainty, over its size; and ratio of tried and predicted "
        "size of a nonlinear effect above which the prediction is not valid",
    )
    unstated: float = number(
        0.1,
        "relative uncertainty of a number whose uncertainty the file does not state, and the smallest 1-sigma of a "
        "derivative over its notable size",
    )
    regressor: float = number(0.1, "variation of a regressor that the notable size refers to", unit="rad")
    resting: float = number(1e-3, "variation of a regressor below which it is noise", unit="rad")


@dataclass(frozen=True, kw_only=True)
class KinematicCriteria:
    """The kinematic check of instruments and moving air, with forces and moments left free."""

    time: float = number(0.2, "correlation time of free specific forces and angular accelerations", unit="s")
    force: float = number(4.0, "1-sigma of a free specific force", unit="m/s2")
    smallest_moment: float = number(0.01, "smallest 1-sigma of a free angular acceleration", unit="rad/s2")
    unmeasured_moment: float = number(
        1.0, "1-sigma of a free angular acceleration whose rate is not measured", unit="rad/s2"
    )
    peak: float = number(
        2.0, "1-sigma of a free angular acceleration over its r.m.s.; manoeuvres take only a part of a record"
    )
    airspeeds: float = number(
        24.0,
        "readings of airspeed in a record from which a check of compatibility reconstructs the motion",
        "derived: the fewest that show their own noise",
    )


@dataclass(frozen=True, kw_only=True)
class TurbulenceCriteria:
    """Thresholds of turbulence, and of what its approximate model leaves unexplained."""

    one_reading: float = number(
        1.5,
        "drift of one reading, over the statistic of turbulence, above which the air is calm",
        "measured: the same decisions from 0.82 on, on 60 sets",
    )
    scale_length: float = number(300.0, "initial scale length", "derived: MIL-F-8785C, at altitude", unit="m")


@dataclass(frozen=True, kw_only=True)
class StructureCriteria:
    """Model discrepancy of linear aircraft models, and its effect on the uncertainty of a value."""

    scales: tuple[float, ...] = number(
        (1.0, 2.0, 4.0),
        "factors of that 1-sigma that are tried for each coefficient",
        "chosen: at most 1 % a part and some 4 % in all",
    )
    known: float = number(
        0.005,
        "smallest relative 1-sigma of a value, and of a statistic",
        "chosen: sampling and the simulator leave that uncertain",
    )
    stretch: float = number(
        5.0,
        "length of the stretches of record that the scatter of a value is computed from, and of the beginning that "
        "states which are not measured are fitted to, for the file as given",
        unit="s",
    )

    @property
    def small(self) -> float:
        """Prior 1-sigma of each part of the model discrepancy, over the variation of its coefficient."""
        return 0.5 * self.known


@dataclass(frozen=True, kw_only=True)
class ScreeningCriteria:
    """Screening of all causes with a linearisation."""

    equivalent: float = number(
        10.0,
        "distance of the statistics within which causes are equivalent",
        "measured: the same decisions from 4.8 to 10.3 on 60 sets",
        unit=_GAIN,
    )


@dataclass(frozen=True, kw_only=True)
class SizeCriteria:
    """Sizes from which an effect matters to an engineer."""

    share: float = number(
        0.05,
        "part of a coefficient's variation that matters, and of the strongest member's significance for another member",
        "measured: linear structure commonly leaves 2 to 4 %",
    )
    consequence: float = number(
        0.02, "part of a coefficient's or channel's variation that an effect on the signal path must change"
    )
    mass: float = number(
        0.5,
        "largest possible relative error of a mass or an inertia",
        "derived: the empty aircraft has half of its largest mass",
    )
    arm: float = number(
        1.5,
        "largest lever arm, in spans",
        "derived: Concorde and the Tu-144, the longest for their span, have 2.4 of them, the c.g. near the middle",
    )
    cg: float = number(
        0.3,
        "largest error of the centre of gravity, in chords",
        "derived: the range that loading makes is smaller for any aircraft",
    )
    wind_along: float = number(20.0, "velocity of the air along x, of which the part `share` matters", unit="m/s")
    wind_across: float = number(3.0, "velocity of the air along y or z, of which the part `share` matters", unit="m/s")

    @property
    def clear(self) -> float:
        """Statistic, times the square of the size in units of what matters, of a cause that is clear: one that just
        matters is known to the part `share` of itself."""
        return (1.0 / self.share) ** 2

    @property
    def ambiguous(self) -> float:
        """Twice `share`, for a configuration change and for what held-out records leave unexplained: a bend in a curve
        resembles a small change, and the structure was not fitted there."""
        return 2.0 * self.share

    @property
    def turbulent(self) -> float:
        """r.m.s. velocity [m/s] above which the air is turbulent."""
        return self.share * self.wind_across


@dataclass(frozen=True, kw_only=True)
class NamingCriteria:
    """Which causes are fitted, which are named, and which are equivalent."""

    gain: float = number(
        40.0,
        "likelihood-ratio statistic, less the selection penalty, for a name",
        "measured: the same decisions up to 880 on 60 sets",
        unit=_GAIN,
    )
    gain_of_an_instrument: float = number(
        25.0, "the same for an instrument fault", "measured: 17 at most on 150 clean sets", unit=_GAIN
    )
    approximate: float = number(
        0.02,
        "the same for an event or turbulence, whose shape is approximate, the least that it leaves elsewhere, and the "
        "share of a fingerprint below which it counts as a combination of derivatives",
    )
    left_to_others: float = number(
        0.001,
        "part of a cause's statistic that it leaves to causes and latent inputs",
        "measured: the same decisions up to 0.03 on 60 sets",
    )
    alike_sigmas: float = number(
        2.0,
        "distance of the statistics of similar causes, in 1-sigmas",
        "derived: 2 sqrt(gain) sin(angle) whichever is true",
    )
    unrelated: float = number(0.95, "sine of the angle between fingerprints above which they are unrelated")


@dataclass(frozen=True, kw_only=True)
class HeldOutCriteria:
    """Held-out records."""

    fitted_part: float = number(2 / 3, "part of a single record that is fitted")


@dataclass(frozen=True, kw_only=True)
class VerdictCriteria:
    """Thresholds of the verdict."""

    missing: float = number(
        150.0,
        "statistic of a latent input, of turbulence or of another timing of the inputs above which it is there",
        "measured: the same decisions from 81 to 590 on 60 sets",
        unit=_GAIN,
    )


@dataclass(frozen=True, kw_only=True)
class GivenCriteria:
    """The simulation as given: what contradicts it, and what the records can judge."""

    fails: float = number(
        10.0,
        "error, over that as given or over the noise, at which a model is far from the data or fails on others",
        "derived: 10 sigmas",
    )
    worse: float = number(1.1, "error over that as given, or over noise, above which it is reported")
    refined: float = number(
        1.5,
        "ratio of errors at which a loss is reported, and error of a simulation that stays within the noise",
    )
    doubtful: float = number(0.9, "factor on probabilities of causes beside an error that nothing accounts for")
    left: float = number(
        2.0,
        "error left, over noise or that of the right model, above which measurements are not compatible, nothing is "
        "explained and no probability exceeds 0.9",
        "derived: three quarters of its square are no noise",
    )


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Limits of the stated probabilities, and the cost of a wrong name."""

    doubt: float = number(
        0.01,
        "probability that channels, noise or priors are wrong; lowers every stated probability",
        "measured: 11 of some 1000 names that blind flights were given were wrong (problems/blind/results.md)",
    )
    wrong: float = number(
        10.0, "cost of a wrong name over that of a missed one", "chosen: somebody searches in the wrong place"
    )
    holds: float = number(0.95, "probability that an ambiguity set holds the true cause")
    numerics: ProbabilityNumerics = ProbabilityNumerics()

    @property
    def named(self) -> float:
        """Probability above which a name is worth its risk: the cost of a wrong name over that of both."""
        return self.wrong / (self.wrong + 1.0)

    def tempered(self, probability: float) -> float:
        """The probability that is stated, with the possibility that channels, noise or priors are wrong."""
        return (1.0 - self.doubt) * probability


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """All criteria of a diagnosis, by subject.

    Examples
    --------
    >>> strict = Criteria().with_values({"naming": {"gain": 80.0}})
    >>> strict.naming.gain
    80.0
    """

    significance: SignificanceCriteria = SignificanceCriteria()
    parts: PartCriteria = PartCriteria()
    data: DataCriteria = DataCriteria()
    noise: NoiseCriteria = NoiseCriteria()
    given: GivenCriteria = GivenCriteria()
    prior: PriorCriteria = PriorCriteria()
    kinematics: KinematicCriteria = KinematicCriteria()
    turbulence: TurbulenceCriteria = TurbulenceCriteria()
    structure: StructureCriteria = StructureCriteria()
    screening: ScreeningCriteria = ScreeningCriteria()
    size: SizeCriteria = SizeCriteria()
    naming: NamingCriteria = NamingCriteria()
    held_out: HeldOutCriteria = HeldOutCriteria()
    verdict: VerdictCriteria = VerdictCriteria()
    priors: Priors = Priors()
    systems: SystemCriteria = SystemCriteria()
    rotors: RotorCriteria = RotorCriteria()
    numerics: Numerics = Numerics()

    @property
    def rows(self) -> tuple[Criterion, ...]:
        """Every number with its name, value, unit, meaning and evidence, as rows of a table."""
        return tuple(listed(self))

    @property
    def changes(self) -> dict[str, Value]:
        """Name -> value of the numbers that differ from their default."""
        return {a.name: a.value for a, b in zip(self.rows, Criteria().rows, strict=True) if a.value != b.value}

    def with_values(self, table: Mapping[str, Any], where: str = "") -> Criteria:
        """Return a copy with other values from a nested table; `where` is named in errors. Raises InputError (see
        `overridden`)."""
        return overridden(self, table, where)

    @classmethod
    def read(cls, path: str | Path) -> Criteria:
        """The defaults with the values of a TOML file, e.g. `[naming]` and below it `gain = 60`.

        raises  InputError for a file that cannot be read, an unknown name or a value of another kind
        """
        return cls().with_values(read_toml(path), str(path))
