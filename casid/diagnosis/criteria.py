"""Every number by which a diagnosis decides: its value, its meaning, and the evidence it rests on.

Gains are drops of the deviance, 2 ln L, for white Gaussian noise chi-square. What has no better evidence is "chosen".
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.diagnosis.criterion import Criterion, Value, listed, number, overridden
from casid.diagnosis.data.criteria import DataCriteria
from casid.diagnosis.flight.criteria import DerivativeSizes, InputTimingCriteria, NoiseCriteria
from casid.diagnosis.numerics import Numerics, ProbabilityNumerics
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.errors import InputError

_GAIN = "2 ln L"


@dataclass(frozen=True, kw_only=True)
class TypicalDerivatives:
    """Smallest size of a derivative that is anywhere near zero, per unit of its regressor, by coefficient."""

    CL: float = number(0.3, "of the lift coefficient")
    CD: float = number(0.05, "of the drag coefficient")
    CX: float = number(0.05, "of the longitudinal force coefficient")
    CZ: float = number(0.3, "of the normal force coefficient")
    CY: float = number(0.1, "of the side force coefficient")
    Cl: float = number(0.02, "of the rolling moment coefficient")
    Cm: float = number(0.1, "of the pitching moment coefficient")
    Cn: float = number(0.02, "of the yawing moment coefficient")

    def of(self, coefficient: str) -> float:
        """By the name of the coefficient."""
        return float(getattr(self, coefficient))


@dataclass(frozen=True, kw_only=True)
class PriorCriteria:
    """What is known of a derivative before the records. One that the file has at zero is as large as `usual`, if it is
    among these."""

    spread: float = number(3.0, "prior 1-sigma of a derivative without a stated one, of its size")
    stated: float = number(
        0.1, "smallest stated 1-sigma, of `typical`", "derived: a relative one says nothing near zero"
    )
    regressor: float = number(0.1, "variation of a regressor for which `typical` is meant", unit="rad")
    resting: float = number(1e-3, "variation of a regressor below which it is noise", unit="rad")
    typical: TypicalDerivatives = TypicalDerivatives()
    usual: DerivativeSizes = DerivativeSizes()


@dataclass(frozen=True, kw_only=True)
class KinematicCriteria:
    """What instruments and moving air must answer for, forces and moments left free."""

    force_time: float = number(0.2, "correlation time of a free specific force", unit="s")
    force: float = number(4.0, "size of a free specific force", unit="m/s2")
    moment_time: float = number(0.2, "correlation time of a free angular acceleration", unit="s")
    smallest_moment: float = number(0.01, "size of a free angular acceleration at least", unit="rad/s2")
    unmeasured_moment: float = number(1.0, "the same where no rate is measured", unit="rad/s2")
    peak: float = number(2.0, "its size in root mean squares: manoeuvres take a part of the time")
    seen: float = number(50.0, "gain that a cause must promise before kinematics can judge it", unit=_GAIN)
    refuted: float = number(0.3, "part of the promised gain below which they refute it")
    confirmed: float = number(0.7, "part of the promised gain above which they confirm it")
    larger: float = number(1.5, "part of the promised gain above which they find another, larger size")
    contradiction: float = number(30.0, "chi-square of their size against the full model's that contradicts it")
    faintly_seen: float = number(
        9.0, "gain from which a cause shows in kinematics at all", "derived: 3 sigmas", unit=_GAIN
    )
    opposed: float = number(8.0, "chi-square by which they refute what shows only faintly")
    smallest_part: float = number(0.5, "smallest part of a predicted size that is tried against them")


@dataclass(frozen=True, kw_only=True)
class TurbulenceCriteria:
    """Whether the air is turbulent, and what its rough model leaves."""

    gain: float = number(150.0, "gain of moving air, and of all axes beyond the best one", unit=_GAIN)
    smallest: float = number(0.15, "r.m.s. velocity above which air is turbulent", unit="m/s")
    other_axes: float = number(
        0.1, "part of the gain that one axis must not reach", "derived: air moves along all axes, a vane along one"
    )
    slow: float = number(0.8, "part of the gain that slow histories of the air must reach, which colour cannot")
    left: float = number(0.02, "part of the gain that its rough model leaves to others")
    rival: float = number(0.3, "part of the gain for a fault in its place, or that may be left beside faults")
    one_reading: float = number(1.5, "times the gain of moving air by a drift of one reading: then no air moves")
    scale_length: float = number(300.0, "scale length to begin with", "derived: MIL-F-8785C, at altitude", unit="m")
    spectrum: float = number(
        0.1, "relative error of the velocity", "derived: a first-order process is not quite a Dryden spectrum"
    )
    roll_damping: float = number(0.4, "-Cl_p of an aircraft file without one")
    pitch_damping: float = number(10.0, "-Cm_q of an aircraft file without one")
    yaw_damping: float = number(0.15, "-Cn_r of an aircraft file without one")


@dataclass(frozen=True, kw_only=True)
class StructureCriteria:
    """Small structural errors that any linear aircraft model has, and what they leave of a value's certainty."""

    small: float = number(0.0025, "prior 1-sigma of each part of small terms, of the variation of its coefficient")
    scales: tuple[float, ...] = number(
        (1.0, 2.0, 4.0), "times that, by coefficient", "chosen: at most 1 % a part and some 4 % in all"
    )
    dependent: float = number(1e-6, "part of a term beside the fitted ones below which it is one of them")
    resting: float = number(1e-7, "variation of a variable below which it rests", "derived: rounding", unit="rad")
    rounding: float = number(
        1e-9, "variation of a term below which it rests, of its size", "derived: rounding, of a surface away from zero"
    )
    ridge: float = number(1e-3, "ridge on the prior of terms that are nearly the sum of others")
    demanded: float = number(50.0, "gain of an expected term or small offset that is put in beforehand", unit=_GAIN)
    oswald: float = number(0.5, "Oswald's factor of a wing at least", "chosen: below the usual 0.7 to 0.85")
    confidence: float = number(1.96, "1-sigmas of an interval that holds the value", "derived: 95 %, Gaussian")
    certain: float = number(
        2.58, "1-sigmas from zero of a value that may be named", "derived: one wrong name in a hundred, Gaussian"
    )
    known: float = number(
        0.005, "relative 1-sigma of a value at least", "chosen: sampling and the simulator leave that open"
    )
    stretch: float = number(
        5.0, "length of the stretches of record by which the scatter of a value is judged", unit="s"
    )
    stretch_part: float = number(0.7, "largest part of a value's information that one stretch counts for")


@dataclass(frozen=True, kw_only=True)
class ScreeningCriteria:
    """What linearisation says of all causes at once."""

    equivalent: float = number(10.0, "distance in gain within which causes are one set", unit=_GAIN)
    equivalent_part: float = number(0.005, "the same relative to the gain, if that is more")
    surviving: float = number(0.02, "share of a fingerprint below which it is a combination of derivatives")
    smallest_size: float = number(0.3, "predicted size of a nonlinear effect, of that tried, below which it is another")
    largest_size: float = number(3.0, "and above which it is another")
    by_chance: float = number(1e-6, "chance of the highest peak of white innovations that makes an oscillation")
    edge: float = number(
        1.0,
        "time from either end of a record within which nothing can set in",
        "derived: unlike what is always there",
        unit="s",
    )


@dataclass(frozen=True, kw_only=True)
class EventCriteria:
    """Causes that set in at a time."""

    interval: float = number(
        10.83,
        "drop of the profile at the ends of an onset's interval",
        "derived: chi-square 99.9 %, for flat profiles",
        unit=_GAIN,
    )
    apart: float = number(2.0, "distance of two onsets from which they are two events", unit="s")
    at_start: float = number(0.1, "time after the first possible onset within which an event is none", unit="s")
    further_price: float = number(2.0, "prices that an event must gain to recur in a further record")
    sudden: float = number(
        0.93,
        "part of a jump's gain that a slow change must not reach",
        "derived: a cubic of time reaches 0.86 of a step",
    )
    always: float = number(0.5, "part of the square that must be its mean, for what jumps to act at any time")
    member: float = number(0.05, "significance of a coefficient that switches with others, of the largest")
    member_sigmas: float = number(4.0, "1-sigmas of a coefficient that switches with others")


@dataclass(frozen=True, kw_only=True)
class SizeCriteria:
    """How large an effect must be to matter to an engineer."""

    share: float = number(
        0.05, "part of a coefficient's variation that matters", "measured: linear structure commonly leaves 2 to 4 %"
    )
    switching: float = number(0.1, "the same of coefficients that switch: a bend in a curve looks like a small switch")
    consequence: float = number(0.02, "part of a coefficient's or channel's variation that an operator must make")
    late: float = number(
        0.5, "lateness of a surface that matters, in sampling intervals", "derived: inputs between samples are unknown"
    )
    mass: float = number(
        0.5,
        "part of a mass or an inertia by which it can be wrong at all",
        "derived: the empty aircraft has half of its largest mass",
    )
    arm: float = number(
        1.5,
        "spans that a lever arm has at most",
        "derived: Concorde and the Tu-144, the longest for their span, have 2.4 of them, the c.g. near the middle",
    )
    cg: float = number(
        0.3,
        "chords by which a centre of gravity can be off",
        "derived: the range in which that of any aircraft may lie, which loading makes, is smaller",
    )
    wind_along: float = number(20.0, "velocity of the air along x of which `share` matters", unit="m/s")
    wind_across: float = number(3.0, "velocity of the air along y or z of which `share` matters", unit="m/s")


@dataclass(frozen=True, kw_only=True)
class NamingCriteria:
    """Which causes are tried, which are named, and which cannot be told apart."""

    gain: float = number(40.0, "gain beyond its price for which a cause is named", unit=_GAIN)
    gain_of_an_instrument: float = number(
        25.0, "the same of a fault of an instrument", "measured: 17 at most on 150 clean sets", unit=_GAIN
    )
    clear: float = number(
        400.0,
        "gain times the square of the size, in units of what matters",
        "derived: 20 sigmas where it just matters",
        unit=_GAIN,
    )
    clear_of_misfit: float = number(
        31.4,
        "the same where the noise is what the fit leaves, misfit of the structure included",
        "derived: 5.6 sigmas, of which `clear` makes 20 to allow for misfit",
        unit=_GAIN,
    )
    tried_size: float = number(0.3, "predicted size from which a cause is tried, of the one that matters")
    tried_gain: float = number(0.3, "predicted gain from which a cause is tried, of the one for a name")
    tried_clear: float = number(0.2, "predicted part of `clear` from which a cause is tried")
    nothing_left: float = number(30.0, "gain of any unknown input below which nothing is missing", unit=_GAIN)
    needed: float = number(25.0, "times the gain for a name, by its 1-sigmas, from which a cause is surely needed")
    left_by_a_cause: float = number(0.002, "part of a cause's gain that its rough model leaves to unknown inputs")
    left_by_an_event: float = number(0.02, "the same of an event, also to another event")
    left_to_others: float = number(0.001, "part of a cause's gain that it leaves to other causes")
    left_behind: float = number(0.2, "part of the named gain for which the best other trial is tried once more")
    rival: float = number(0.7, "part of a cause's gain from which another one is a rival")
    rival_angle: float = number(0.8, "sine of the angle between fingerprints below which it is a rival")
    give_up: float = number(0.2, "part of the best gain behind it at which a trial is given up")
    alike: float = number(0.6, "sine of the angle between fingerprints that resemble each other")
    alike_sigmas: float = number(
        2.0, "1-sigmas of the difference of their gains", "derived: 2 sqrt(gain) sin(angle) whichever is true"
    )
    unrelated: float = number(0.95, "sine of the angle between fingerprints that have nothing in common")


@dataclass(frozen=True, kw_only=True)
class DoubtCriteria:
    """Whether a cause explains what was missing, or imitates it."""

    left: float = number(
        0.25, "part of an unknown input's gain that may stay", "measured: causes leave hardly any, imitations a fifth"
    )
    left_by_terms: float = number(0.1, "part that may stay of a term or a switch, which imitate anything")
    helped: float = number(0.35, "part of a cause's gain that an input must lose for its station to be judged")
    worse: float = number(1.3, "times what was missing at a station, above which a cause makes more missing")
    worse_part: float = number(0.02, "part of the cause's gain that may be missing besides")


@dataclass(frozen=True, kw_only=True)
class HeldOutCriteria:
    """Records that no fit has seen."""

    fitted_part: float = number(2 / 3, "part of a single record that is fitted")
    missing_share: float = number(
        0.1,
        "part of a variation that may be missing there",
        "chosen: twice what matters; the structure was not fitted there",
    )


@dataclass(frozen=True, kw_only=True)
class VerdictCriteria:
    """What is said in the end."""

    missing: float = number(150.0, "gain of an unknown input above which something is missing", unit=_GAIN)
    detectable: float = number(
        5.6,
        "1-sigmas of the smallest detectable size",
        "derived: power 90 %, false alarm 1e-4 over a hundred candidates",
    )
    minor_part: float = number(0.75, "part of what is missing that a minor cause must gain to be what is missing")
    small_term: float = number(6.0, "1-sigmas of a small term that is worth a line")
    stated: int = number(3, "findings of a kind that the sentence states one by one; the page has all")


@dataclass(frozen=True, kw_only=True)
class GivenCriteria:
    """The simulation as it is given: what contradicts it, and what the records can tell of."""

    window: float = number(
        5.0, "beginning of a record to which states that are not measured are fitted, of the file as given", unit="s"
    )
    beginning: float = number(
        1.0, "beginning of a record that tells where a measured state begins, of the file as given", unit="s"
    )
    sigmas: float = number(3.0, "honest 1-sigmas by which flight contradicts a number of the file", "derived: 3 sigmas")
    unstated: float = number(0.1, "part of a number within which it stands where its uncertainty is not stated")
    from_records: float = number(
        0.5, "part of the information on a number that must come from the records", "derived: more than the file's own"
    )
    still: float = number(
        0.25,
        "motion of an axis, of the other's, below which it is not judged",
        "measured: records of one axis show 0.03 to 0.21, of all axes 0.3 and more",
    )
    worse: float = number(1.05, "ratio of the error on held-out records that is a loss")
    fails: float = number(
        10.0, "ratio of the error on held-out records, or of that to the noise, at which the extended model fails"
    )
    above_noise: float = number(1.1, "error over noise that shows")
    refined: float = number(1.5, "ratio of errors that values within their stated uncertainty must gain for a word")


@dataclass(frozen=True, kw_only=True)
class Priors:
    """How sure what is told can be, and what a wrong name costs."""

    doubt: float = number(
        0.01,
        "probability that columns, noise or priors are wrong altogether, by which all that is told is less sure",
        "measured: 11 of some 1000 names that blind flights were given were wrong (problems/blind/results.md)",
    )
    wrong: float = number(10.0, "cost of a wrong name", "chosen: it sends someone to look in the wrong place")
    missed: float = number(1.0, "cost of a name that is not given", "derived: the unit of cost")
    holds: float = number(0.95, "probability that a set of causes which stand for each other must hold")
    numerics: ProbabilityNumerics = ProbabilityNumerics()

    @property
    def named(self) -> float:
        """Probability from which a name is worth its risk: the cost of a wrong one over the sum of both costs."""
        return self.wrong / (self.wrong + self.missed)

    def tempered(self, probability: float) -> float:
        """What is told of a probability within columns, noise and priors."""
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

    data: DataCriteria = DataCriteria()
    noise: NoiseCriteria = NoiseCriteria()
    given: GivenCriteria = GivenCriteria()
    input_timing: InputTimingCriteria = InputTimingCriteria()
    prior: PriorCriteria = PriorCriteria()
    kinematics: KinematicCriteria = KinematicCriteria()
    turbulence: TurbulenceCriteria = TurbulenceCriteria()
    structure: StructureCriteria = StructureCriteria()
    screening: ScreeningCriteria = ScreeningCriteria()
    events: EventCriteria = EventCriteria()
    size: SizeCriteria = SizeCriteria()
    naming: NamingCriteria = NamingCriteria()
    doubt: DoubtCriteria = DoubtCriteria()
    held_out: HeldOutCriteria = HeldOutCriteria()
    verdict: VerdictCriteria = VerdictCriteria()
    priors: Priors = Priors()
    systems: SystemCriteria = SystemCriteria()
    numerics: Numerics = Numerics()

    @property
    def rows(self) -> tuple[Criterion, ...]:
        """Every number with its name, value, unit, meaning and evidence, as rows of a table."""
        return tuple(listed(self))

    @property
    def changes(self) -> dict[str, Value]:
        """Name -> value of the numbers that are not at their default."""
        return {a.name: a.value for a, b in zip(self.rows, Criteria().rows, strict=True) if a.value != b.value}

    def with_values(self, table: Mapping[str, Any], where: str = "") -> Criteria:
        """With other values from a nested table; `where` is named in errors. Raises InputError (see `overridden`)."""
        return overridden(self, table, where)

    @classmethod
    def read(cls, path: str | Path) -> Criteria:
        """The defaults with the values of a TOML file, e.g. `[naming]` and below it `gain = 60`.

        Raises
        ------
        InputError
            For a file that cannot be read, an unknown name or a value of another kind.
        """
        try:
            table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"{path}: no criteria can be read from it: {error}") from None
        return cls().with_values(table, str(path))
