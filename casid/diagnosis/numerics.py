"""Resolution and extent of every search: grids, iterations and numbers of trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from numpy.polynomial.legendre import legvander

from casid.criterion import number

Extent = Literal["plain", "first", "settled", "trial", "motion", "rough", "again", "nearly"]  # of a fit


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Gauss-Newton fit of a hypothesis."""

    shrink: float = number(0.4, "factor by which a step that does not decrease the deviance is shortened")
    shortest_step: float = number(0.02, "part of a step below which a fit stops")
    promise: float = number(
        0.25, "part of the previous step's predicted decrease below which a step counts as progress"
    )
    squares: float = number(1.01, "ratio of sums of squares within which such a step counts")
    repeats: int = number(
        8,
        "largest number of fits that follow one another until turbulence, noise, colour or outliers stay, and of "
        "smoothings of a system's motion",
    )
    moved: float = number(0.5, "largest change of a value that ends fits in turbulence, in 1-sigmas")
    noise_stays: float = number(0.03, "relative change of the noise that ends fits in which it is estimated")
    first_noise: float = number(0.02, "noise of a channel in the first of them, over its variation")
    whiteness_lags: int = number(20, "lags of the Ljung-Box statistic")
    plain: tuple[float, ...] = number(
        (10.0, 0.5), "largest number of iterations, and change of the sum of squares at which a fit ends"
    )
    first: tuple[float, ...] = number((20.0, 0.5), "the same for a fit that begins far from its end")
    settled: tuple[float, ...] = number((15.0, 0.3), "the same for a model that is kept")
    trial: tuple[float, ...] = number((8.0, 3.0), "the same while a cause is tried")
    motion: tuple[float, ...] = number((6.0, 1.0), "the same where the motion alone is fitted")
    rough: tuple[float, ...] = number((10.0, 2.0), "the same without aerodynamics, in moving air, and for onsets")
    again: tuple[float, ...] = number((5.0, 2.0), "the same for kinematics with one more cause")
    nearly: tuple[float, ...] = number((2.0, 2.0), "the same for small offsets of instruments")


@dataclass(frozen=True, kw_only=True)
class LevelNumerics:
    """Search for sizes of noise with the model."""

    least: float = number(0.5, "part of the noise of a reading by its high band below which it is not sought")
    factors: tuple[float, ...] = number((4.0, 2.0, 1.4), "steps by which sizes are sought; in turbulence the last one")
    sweeps: int = number(4, "largest number of rounds with each step")
    gained: float = number(2.0, "decrease of the deviance below which a round is the last one")


@dataclass(frozen=True, kw_only=True)
class TurbulenceNumerics:
    """Search for strength and scale of turbulence."""

    velocities: tuple[float, ...] = number(
        (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2), "r.m.s. velocities that are tried", unit="m/s"
    )
    length_ratio: float = number(2.5, "ratio of the scale lengths that are tried")
    beyond: float = number(1.5, "largest distance of the peak of a parabola from the middle of its grid, in steps")
    rolling: tuple[float, ...] = number((0.3, 1.0, 3.0), "factors of the air's roll rate in MIL-F-8785C that are tried")


@dataclass(frozen=True, kw_only=True)
class MissingInputNumerics:
    """Latent input at a port: nodes of its time history, and the sizes that are tried."""

    times: tuple[float, ...] = number(
        (0.4, 1.5, 6.0),
        "correlation times of a force or of moving air that are tried; its nodes are as far apart as the shortest",
        unit="s",
    )
    drift_spacing: float = number(2.0, "time between nodes of a drifting reading", unit="s")
    drift_times: tuple[float, ...] = number(
        (6.0, 20.0), "correlation times of a drifting reading that are tried", unit="s"
    )
    most_nodes: int = number(500, "largest number of nodes of all records; longer records have wider spacing")
    sizes: tuple[float, ...] = number(
        (1e-3, 1e6), "smallest and largest variance that are tried, in units of the best-determined direction"
    )
    variances: int = number(46, "number of variances that are tried, in equal logarithmic steps")
    highest_frequency: float = number(0.4, "highest frequency of an oscillation, over the sampling rate")


@dataclass(frozen=True, kw_only=True)
class ScreeningNumerics:
    """Screening of all causes."""

    starts: int = number(4, "number of records from which sets of records are grown")


@dataclass(frozen=True, kw_only=True)
class EventNumerics:
    """Search for the onset of an event."""

    step: float = number(
        1.0,
        "time between the onsets that are tried, from either end of a record, where an event would resemble a "
        "permanent effect, and half width of the fine part of a profile",
        unit="s",
    )
    fine_up_to: float = number(30.0, "length of a record up to which this time is used", unit="s")
    fine: float = number(0.1, "time between points of a profile near its peak; onsets stay within half of it", unit="s")
    moves: int = number(6, "largest number of moves of an onset")
    trial_moves: int = number(2, "the same while a cause is tried, and in held-out records")
    slow_polynomials: int = number(4, "Legendre polynomials of time that represent a slow change")

    @property
    def sudden(self) -> float:
        """Part of a jump's statistic that a slow change must stay below: half way from the part of a step amid a record
        that these polynomials reach, which is 0.86 for a cubic, to the whole."""
        at_zero = legvander([0.0], self.slow_polynomials)[0]
        odd = range(1, self.slow_polynomials, 2)
        return 0.5 + 0.5 * sum(float(at_zero[k - 1] - at_zero[k + 1]) ** 2 / (2 * k + 1) for k in odd)

    @property
    def coarse(self) -> float:
        """Time [s] between points of a profile away from its peak."""
        return 0.5 * self.step

    @property
    def apart(self) -> float:
        """Distance [s] of two onsets above which they are two events."""
        return 2.0 * self.step

    @property
    def gust_step(self) -> float:
        """Time [s] between the onsets that are tried for a short gust of known size."""
        return 2.0 * self.fine


@dataclass(frozen=True, kw_only=True)
class NamingNumerics:
    """Number and kind of the causes that are fitted in each round."""

    rounds: int = number(6, "largest number of rounds")
    tentative: int = number(
        2, "rounds in turn that may name nothing, or be refused until the named causes together explain what is missing"
    )
    trials: int = number(
        4, "candidates of the first ranking that are fitted, and terms of one coefficient if they predict the same"
    )
    further_trials: int = number(
        2, "candidates of each other ranking, and terms of one coefficient otherwise, that are fitted"
    )
    side_by_side: int = number(2, "trials that are fitted at a time; later ones are abandoned if they fall behind")
    rivals: int = number(2, "alternatives of a named cause that are fitted again")
    ranking: int = number(40, "candidates that the result keeps")
    listed: int = number(3, "findings of a kind, or small terms, that a verdict lists one by one")


@dataclass(frozen=True, kw_only=True)
class SystemNumerics:
    """The search in a system that is no aircraft, whose fits are quick."""

    wider: int = number(2, "factor of the causes that are fitted, and of the iterations of each fit")


@dataclass(frozen=True, kw_only=True)
class StructureNumerics:
    """Terms that the model lacks."""

    rounding: float = number(
        1e-6, "variation of an angle [rad], or of a term over its size, below which it is constant or equals others"
    )
    ridge: float = number(1e-3, "ridge on the prior of terms that are nearly the sum of others")


@dataclass(frozen=True, kw_only=True)
class ProbabilityNumerics:
    """Probabilities that are reported."""

    reported: int = number(8, "combinations of causes that are reported")
    least: float = number(1e-4, "smallest probability of a cause that is reported")


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Resolution and extent of every search."""

    samples_per_cycle: float = number(
        25.0,
        "samples per cycle of the highest frequency of the motion that records are averaged to",
        "measured: a lag of 0.12 s keeps 96 % of its statistic with 36 samples, 85 % with 24 (docs/diagnosis.md)",
    )
    fit: FitNumerics = FitNumerics()
    levels: LevelNumerics = LevelNumerics()
    turbulence: TurbulenceNumerics = TurbulenceNumerics()
    missing_input: MissingInputNumerics = MissingInputNumerics()
    screening: ScreeningNumerics = ScreeningNumerics()
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()
    structure: StructureNumerics = StructureNumerics()
    systems: SystemNumerics = SystemNumerics()
