"""Resolution and extent of every search: grids, iterations and numbers of trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial.legendre import legvander

from casid.criterion import number

Extent = Literal["settled", "rough"]  # of a fit


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Gauss-Newton fit of a hypothesis."""

    repeats: int = number(
        8,
        "largest number of rounds of the search, of instruments that are corrected one after the other, of fits that "
        "follow one another until turbulence, noise, colour or outliers stay, of smoothings of the motion of a system, "
        "and of moves of an onset",
    )
    stays: float = number(
        0.03,
        "relative change of the noise that ends fits in which it is estimated, and its first value over the variation "
        "of a channel; and of the sum of squares by which a step that counts may raise it",
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


@dataclass(frozen=True, kw_only=True)
class MissingInputNumerics:
    """Latent input at a port: nodes of its time history, and the sizes that are tried."""

    times: tuple[float, ...] = number(
        (0.4, 1.5, 6.0, 20.0),
        "correlation times that are tried: the first three of a force or of moving air, whose nodes are as far apart "
        "as the shortest, the last two of a drifting reading",
        unit="s",
    )
    most_nodes: int = number(500, "largest number of nodes of all records; longer records have wider spacing")
    sizes: tuple[float, ...] = number(
        (1e-3, 1e6), "smallest and largest variance that are tried, in units of the best-determined direction"
    )

    @property
    def quick(self) -> tuple[float, ...]:
        """Correlation times [s] of a force or of moving air."""
        return self.times[:3]

    @property
    def slow(self) -> tuple[float, ...]:
        """Correlation times [s] of a drifting reading."""
        return self.times[2:]


@dataclass(frozen=True, kw_only=True)
class EventNumerics:
    """Search for the onset of an event."""

    step: float = number(
        1.0,
        "time between the onsets that are tried; from either end of a record, where an event would resemble a "
        "permanent effect, and a measured state shows its initial value; and half width of the fine part of a profile",
        unit="s",
    )
    slow_polynomials: int = number(4, "Legendre polynomials of time that represent a slow change")

    @property
    def sudden(self) -> float:
        """Part of a jump's statistic that a slow change must stay below: half way from the part of a step amid a record
        that these polynomials reach, which is 0.86 for a cubic, to the whole."""
        at_zero = legvander([0.0], self.slow_polynomials)[0]
        odd = range(1, self.slow_polynomials, 2)
        return 0.5 + 0.5 * sum(float(at_zero[k - 1] - at_zero[k + 1]) ** 2 / (2 * k + 1) for k in odd)

    @property
    def fine(self) -> float:
        """Time [s] between points of a profile near its peak; onsets stay within half of it."""
        return self.step / 10.0

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

    trials: int = number(
        4,
        "candidates of the first ranking that are fitted, terms of one coefficient if they predict the same, records "
        "from which sets of records are grown, findings of a kind, or small terms, that a verdict lists one by one, "
        "and rounds with each step of a search for sizes of noise",
    )
    few: int = number(
        2,
        "rounds in turn that may name nothing, or be refused until the named causes together explain what is missing; "
        "trials that are fitted at a time, of which later ones are abandoned if they fall behind; alternatives of a "
        "named cause that are fitted again; moves of an onset while a cause is tried, and in held-out records; and "
        "factor of the causes that are fitted to a system, whose fits are quick, and of the iterations of each",
    )
    ranking: int = number(40, "candidates, and combinations of causes, that the result keeps")

    @property
    def further_trials(self) -> int:
        """Candidates of each other ranking, and terms of one coefficient that do not predict the same, that are
        fitted."""
        return max(1, self.trials // 2)


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Resolution and extent of every search."""

    samples_per_cycle: float = number(
        25.0,
        "samples per cycle of the highest frequency of the motion that records are averaged to, lags of the Ljung-Box "
        "statistic, and readings of airspeed from which a check of compatibility reconstructs the motion",
        "measured: a lag of 0.12 s keeps 96 % of its statistic with 36 samples, 85 % with 24 (docs/diagnosis.md)",
    )
    record: float = number(
        26.0,
        "length of a record for which all numbers in seconds are meant; those of a system are longer or shorter with "
        "its records, and onsets are farther apart in longer ones",
        "measured: the records of aircraft by which these were set",
    )
    fit: FitNumerics = FitNumerics()
    missing_input: MissingInputNumerics = MissingInputNumerics()
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()

    @property
    def rounding(self) -> float:
        """Variation of an angle [rad], or of a term over its size, below which it is constant or equals others."""
        return float(np.sqrt(np.finfo(float).eps))
