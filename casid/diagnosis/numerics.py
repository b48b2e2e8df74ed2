"""Resolution and extent of every search: grids, iterations and numbers of trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from numpy.polynomial.legendre import legvander

from casid.criterion import number

Extent = Literal["settled", "rough"]  # of a fit


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Gauss-Newton fit of a hypothesis."""

    squares: float = number(1.01, "ratio of sums of squares within which such a step counts")
    repeats: int = number(
        8,
        "largest number of fits that follow one another until turbulence, noise, colour or outliers stay; of "
        "smoothings of the motion of a system; and of moves of an onset",
    )
    noise_stays: float = number(
        0.03,
        "relative change of the noise that ends fits in which it is estimated, and its first value over the variation "
        "of a channel",
    )
    settled: tuple[float, ...] = number(
        (20.0, 0.5),
        "largest number of iterations, and change of the sum of squares at which a fit ends, of a model that is kept",
    )
    rough: tuple[float, ...] = number(
        (8.0, 2.0),
        "the same while a cause is tried, without aerodynamics, in moving air, and for onsets; and the decrease of the "
        "deviance below which a round of a search for sizes of noise is the last one",
    )
    whiteness_lags: int = number(20, "lags of the Ljung-Box statistic")


@dataclass(frozen=True, kw_only=True)
class LevelNumerics:
    """Search for sizes of noise with the model."""

    factors: tuple[float, ...] = number((4.0, 2.0, 1.4), "steps by which sizes are sought; in turbulence the last one")
    sweeps: int = number(4, "largest number of rounds with each step")


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
class EventNumerics:
    """Search for the onset of an event."""

    step: float = number(
        1.0,
        "time between the onsets that are tried; from either end of a record, where an event would resemble a "
        "permanent effect, and a measured state shows its initial value; and half width of the fine part of a profile",
        unit="s",
    )
    fine_up_to: float = number(30.0, "length of a record up to which this time is used", unit="s")
    fine: float = number(0.1, "time between points of a profile near its peak; onsets stay within half of it", unit="s")
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
    trials: int = number(
        4,
        "candidates of the first ranking that are fitted, terms of one coefficient if they predict the same, and "
        "records from which sets of records are grown",
    )
    few: int = number(
        2,
        "rounds in turn that may name nothing, or be refused until the named causes together explain what is missing; "
        "trials that are fitted at a time, of which later ones are abandoned if they fall behind; alternatives of a "
        "named cause that are fitted again; and moves of an onset while a cause is tried, and in held-out records",
    )
    ranking: int = number(40, "candidates that the result keeps")
    listed: int = number(3, "findings of a kind, or small terms, that a verdict lists one by one")

    @property
    def further_trials(self) -> int:
        """Candidates of each other ranking, and terms of one coefficient that do not predict the same, that are
        fitted."""
        return max(1, self.trials // 2)


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
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()
    structure: StructureNumerics = StructureNumerics()
    systems: SystemNumerics = SystemNumerics()
