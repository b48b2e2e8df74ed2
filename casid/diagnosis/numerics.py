"""Resolution and extent of every search: grids, iterations and numbers of trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from casid.criterion import number

Extent = Literal["plain", "rough", "motion", "nearly"]  # of a fit


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Gauss-Newton fit of a hypothesis."""

    promise: float = number(
        0.25, "part of the previous step's predicted decrease below which a step counts as progress"
    )
    repeats: int = number(
        8,
        "largest number of fits that follow one another until turbulence, noise, colour or outliers stay, and of "
        "smoothings of a system's motion",
    )
    first_noise: float = number(0.02, "noise of a channel in the first of them, over its variation")
    noise_stays: float = number(0.03, "relative change of the noise that ends fits in which it is estimated")
    whiteness_lags: int = number(20, "lags of the Ljung-Box statistic")
    plain: tuple[float, ...] = number(
        (20.0, 0.5),
        "largest number of iterations, and change of the sum of squares at which a fit ends; in turbulence also "
        "that of a value at which fits that follow one another end",
    )
    rough: tuple[float, ...] = number(
        (8.0, 2.0),
        "the same while a cause is tried, in moving air, for onsets, and for the trajectory alone",
    )
    motion: tuple[float, ...] = number((5.0, 2.0), "the same without aerodynamics")
    nearly: tuple[float, ...] = number((2.0, 2.0), "the same where little is left to change")


@dataclass(frozen=True, kw_only=True)
class TurbulenceNumerics:
    """Search for strength and scale of turbulence."""

    velocities: tuple[float, ...] = number(
        (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2), "r.m.s. velocities that are tried", unit="m/s"
    )
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


@dataclass(frozen=True, kw_only=True)
class EventNumerics:
    """Search for the onset of an event."""

    step: float = number(
        1.0,
        "time between the onsets that are tried, from either end of a record, where an event would resemble a "
        "permanent effect, and half width of the fine part of a profile",
        unit="s",
    )
    fine: float = number(0.1, "time between points of a profile near its peak; onsets stay within half of it", unit="s")
    moves: int = number(6, "largest number of moves of an onset")
    trial_moves: int = number(2, "the same while a cause is tried, and in held-out records")

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
    tentative: int = number(2, "rounds that may be refused until the named causes together explain what is missing")
    trials: int = number(
        4,
        "candidates of the first ranking that are fitted, twice those of another ranking; terms of one coefficient if "
        "they predict the same, twice as many as otherwise",
    )
    side_by_side: int = number(2, "trials that are fitted at a time; later ones are abandoned if they fall behind")
    rivals: int = number(2, "alternatives of a named cause that are fitted again")
    starts: int = number(4, "records from which sets of records are grown")
    ranking: int = number(40, "candidates that the result keeps")
    listed: int = number(3, "findings of a kind, or small terms, that a verdict lists one by one")

    @property
    def further_trials(self) -> int:
        """Candidates of each other ranking, and terms of one coefficient otherwise, that are fitted."""
        return max(self.trials // 2, 1)


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
class Numerics:
    """Resolution and extent of every search."""

    samples_per_cycle: float = number(
        25.0,
        "samples per cycle of the highest frequency of the motion that records are averaged to",
        "measured: a lag of 0.12 s keeps 96 % of its statistic with 36 samples, 85 % with 24 (docs/diagnosis.md)",
    )
    fit: FitNumerics = FitNumerics()
    turbulence: TurbulenceNumerics = TurbulenceNumerics()
    missing_input: MissingInputNumerics = MissingInputNumerics()
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()
    structure: StructureNumerics = StructureNumerics()
    systems: SystemNumerics = SystemNumerics()
