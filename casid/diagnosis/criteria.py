"""Every number by which a diagnosis decides, with its value, its meaning and its evidence.

A statistic is a likelihood-ratio statistic, 2 ln L: for white Gaussian noise it is about chi-square distributed if the
cause is absent. A number without better evidence is marked as "chosen". All of these that no gate names, moved at once
by a factor of 1.4, left verdict and names of 86 of 88 blind sets as they were (problems/blind/ablation.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.criterion import Criterion, Value, listed, number, overridden
from casid.data_check.criteria import DataCriteria
from casid.diagnosis.numerics import Numerics
from casid.diagnosis.rotor_criteria import RotorCriteria
from casid.records.limits import read_toml

_GAIN = "2 ln L"


@dataclass(frozen=True, kw_only=True)
class SignificanceCriteria:
    """Likelihood-ratio statistics that noise alone does not reach."""

    chance: float = number(
        9.0,
        "statistic of one number that is significant; distance of the statistics within which causes are equivalent",
        "derived: 3 sigmas, 0.3 %; the same decisions from 4.8 to 10.3 on 60 sets",
        unit=_GAIN,
    )
    search: float = number(
        31.4,
        "statistic of the best of many candidates that is significant; less the selection penalty, that of a name",
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
        "sampling intervals, and change in 1-sigmas, from which they matter; and lowest Oswald factor of a "
        "wing",
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
        "error of its velocity, as a first-order process only approximates a Dryden spectrum; relative uncertainty "
        "of a number whose uncertainty the file does not state, smallest 1-sigma of a derivative over its notable size "
        "and variation of a regressor that this size refers to",
        "measured: imitations left 0.12; the same decisions from 0.099 to 0.318 on 86 sets",
    )

    @property
    def most(self) -> float:
        """What a third leaves; of a single record it is fitted, and the rest is held out."""
        return 1.0 - self.third

    @property
    def slightly(self) -> float:
        """Ratio of errors from which a difference is reported: a tenth more."""
        return 1.0 + self.tenth

    @property
    def otherwise(self) -> float:
        """Ratio of two densities of noise that exceeds the scatter of a high band: a quarter more."""
        return 1.0 + self.quarter

    @property
    def clearly(self) -> float:
        """Ratio of errors at which a loss is reported, within which a simulation stays within the noise; and steps of a
        grid of three within which the peak of a parabola is its own: half more."""
        return 1.0 + self.half

    @property
    def twice(self) -> float:
        """Error left, over noise or that of the right model, above which measurements are not compatible, nothing is
        explained and no probability exceeds `doubtful`: three quarters of its square are no noise. Mean square residual
        up to which slow residuals are noise of the instrument: its slow part is as strong as the fast one. 1-sigma of a
        free angular acceleration over its r.m.s.: manoeuvres take only a part of a record."""
        return 1.0 / self.half

    @property
    def steps(self) -> tuple[float, ...]:
        """Steps by which sizes of noise are sought: four, two and the root of two; in turbulence the last one."""
        return self.twice**2, self.twice, self.twice**0.5

    @property
    def doubtful(self) -> float:
        """Factor on probabilities of causes beside an error that nothing accounts for."""
        return 1.0 - self.tenth

    @property
    def tenfold(self) -> float:
        """Error, over that as given or over the noise, at which a model is far from the data or fails on others."""
        return 1.0 / self.tenth


@dataclass(frozen=True, kw_only=True)
class NoiseCriteria:
    """Which channels count as measured, and how strong their noise is."""

    present: float = number(
        0.1,
        "part of a record's samples above which a channel counts as measured, and short of which it is read at all",
    )
    smallest: float = number(
        1e-3,
        "smallest noise, over a channel's variation; and variation of an angle or regressor below which it rests",
        "derived: a noise-free simulation must not have infinite weight",
    )


@dataclass(frozen=True, kw_only=True)
class KinematicCriteria:
    """The kinematic check of instruments and moving air, with forces and moments left free."""

    time: float = number(0.2, "correlation time of free specific forces and angular accelerations", unit="s")
    force: float = number(4.0, "1-sigma of a free specific force", unit="m/s2")
    unmeasured_moment: float = number(
        1.0, "1-sigma of a free angular acceleration whose rate is not measured", unit="rad/s2"
    )
    scale_length: float = number(
        300.0, "scale length of turbulence to begin with", "derived: MIL-F-8785C, at altitude", unit="m"
    )


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
        "smallest relative 1-sigma of a value, and of a statistic; and part of a cause's statistic that it leaves to "
        "causes and latent inputs",
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
class SizeCriteria:
    """Sizes from which an effect matters to an engineer."""

    share: float = number(
        0.05,
        "part of a coefficient's variation that matters, and of the strongest member's significance for another member",
        "measured: linear structure commonly leaves 2 to 4 %",
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

    @property
    def velocities(self) -> tuple[float, ...]:
        """r.m.s. velocities [m/s] that are tried: from that across down to a third of `turbulent`, each the half."""
        halved = 2 + math.floor(-math.log2(self.share))
        return tuple(self.wind_across * 0.5**i for i in range(halved, -1, -1))


@dataclass(frozen=True, kw_only=True)
class NamingCriteria:
    """Which causes are fitted, which are named, and which are equivalent."""

    approximate: float = number(
        0.02,
        "part of the statistic of an event or of turbulence that it leaves to causes and latent inputs, as its shape "
        "is approximate; share of a fingerprint below which it counts as a combination of derivatives; and part of a "
        "coefficient's or channel's variation that an effect on the signal path must change",
    )
    alike_sigmas: float = number(
        2.0,
        "distance of the statistics of similar causes, in 1-sigmas",
        "derived: 2 sqrt(gain) sin(angle) whichever is true",
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
    >>> strict = Criteria().with_values({"significance": {"search": 80.0}})
    >>> strict.significance.search
    80.0
    """

    significance: SignificanceCriteria = SignificanceCriteria()
    parts: PartCriteria = PartCriteria()
    data: DataCriteria = DataCriteria()
    noise: NoiseCriteria = NoiseCriteria()
    kinematics: KinematicCriteria = KinematicCriteria()
    structure: StructureCriteria = StructureCriteria()
    size: SizeCriteria = SizeCriteria()
    naming: NamingCriteria = NamingCriteria()
    priors: Priors = Priors()
    rotors: RotorCriteria = RotorCriteria()
    numerics: Numerics = Numerics()

    @property
    def missing(self) -> float:
        """Statistic above which a latent input, turbulence or another timing of the inputs is there: a third of that of
        a cause that is clear. The same decisions from 81 to 590 on 60 sets."""
        return self.parts.third * self.size.clear

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
        """The defaults with the values of a TOML file, e.g. `[significance]` and below it `search = 60`.

        raises  InputError for a file that cannot be read, an unknown name or a value of another kind
        """
        return cls().with_values(read_toml(path), str(path))
