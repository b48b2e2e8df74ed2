"""Resolution and extent of the searches of a diagnosis: grids, counts, memory. Larger values take more time."""

from __future__ import annotations

from dataclasses import dataclass

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Gauss-Newton fit of a hypothesis."""

    shrink: float = number(0.4, "factor by which a step that does not decrease the deviance is shortened")
    shortest_step: float = number(0.02, "part of a step below which a fit stops")
    promise: float = number(
        0.25, "part of the previous step's predicted decrease below which a step counts as progress"
    )
    squares: float = number(1.01, "ratio of sums of squares within which such a step counts")
    relaxations: int = number(5, "largest number of fits in turbulence, each with the filter of the previous one")
    moved: float = number(0.5, "largest change of a value that ends these fits, in 1-sigmas")
    far: float = number(
        100.0,
        "deviance per reading of an unconverged fit above which it is repeated from another start",
        "derived: 10 sigmas",
    )
    outlier_fits: int = number(3, "largest number of fits until no outlier is found")
    wider: float = number(10.0, "factor of the noise under which such a fit is repeated")
    noise_fits: int = number(2, "fits in which the noise of doubted channels is estimated")
    noise_iterations: int = number(6, "iterations of each of these fits")
    noise_tolerance: float = number(10.0, "decrease of the deviance at which each of these fits ends", unit="2 ln L")
    noise_level_fits: int = number(
        8, "largest number of fits in which the noise level of doubted channels is estimated"
    )
    colour_fits: int = number(3, "largest number of fits in which the colour of their noise is estimated")
    noise_stays: float = number(0.03, "relative change of the noise that ends these fits")
    states_iterations: int = number(6, "iterations of a fit of initial states alone")
    states_tolerance: float = number(1.0, "decrease of the deviance at which such a fit ends", unit="2 ln L")
    whiteness_lags: int = number(20, "lags of the Ljung-Box statistic")


@dataclass(frozen=True, kw_only=True)
class TurbulenceNumerics:
    """Search for strength and scale of turbulence."""

    velocities: tuple[float, ...] = number(
        (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2), "r.m.s. velocities that are tried", unit="m/s"
    )
    first_velocity: float = number(0.2, "velocity that is tried first", unit="m/s")
    worse: float = number(20.0, "rise of the deviance that ends the search along the velocity", unit="2 ln L")
    length_ratio: float = number(2.5, "ratio of the scale lengths that are tried")
    velocity_ratio: float = number(2.0, "ratio of the extreme velocities that are tried once the length is known")
    beyond: float = number(1.5, "largest distance of the peak of a parabola from the middle of its grid, in steps")
    rolling: tuple[float, ...] = number((0.3, 1.0, 3.0), "factors of the air's roll rate in MIL-F-8785C that are tried")
    turning: tuple[float, float] = number(
        (-1.0, 1.0),
        "signs of the air's pitch and yaw rates due to the gradient of its velocity, tried first",
        signed=True,
    )
    repairs: int = number(3, "largest number of faults that are tried in place of turbulence")


@dataclass(frozen=True, kw_only=True)
class MissingInputNumerics:
    """Latent input at a port: nodes of its time history, and the sizes that are tried."""

    spacing: float = number(0.4, "time between nodes of a force or of moving air", unit="s")
    times: tuple[float, ...] = number(
        (0.4, 1.5, 6.0), "correlation times of a force or of moving air that are tried", unit="s"
    )
    drift_spacing: float = number(2.0, "time between nodes of a drifting reading", unit="s")
    drift_times: tuple[float, ...] = number(
        (6.0, 20.0), "correlation times of a drifting reading that are tried", unit="s"
    )
    most_nodes: int = number(500, "largest number of nodes of all records; longer records have wider spacing")
    smallest_variance: float = number(
        1e-3, "smallest variance that is tried, in units of the best-determined direction"
    )
    largest_variance: float = number(1e6, "largest variance that is tried, in the same units")
    variances: int = number(46, "number of variances that are tried, in equal logarithmic steps")
    highest_frequency: float = number(0.4, "highest frequency of an oscillation, over the sampling rate")


@dataclass(frozen=True, kw_only=True)
class ScreeningNumerics:
    """Screening of all causes."""

    samples: int = number(64, "samples whose whitened small terms are in memory together: they stay in the cache")
    columns: int = number(32, "responses or columns in memory together, whole tiles of the compiled filter")
    starts: int = number(4, "number of records from which sets of records are grown")
    onset_step: float = number(1.0, "time between the onsets that are tried", unit="s")
    fine_up_to: float = number(30.0, "length of a record up to which this time is used", unit="s")
    longest_start: float = number(1.5, "largest initial size of the fit of a nonlinear effect, over the tried size")


@dataclass(frozen=True, kw_only=True)
class EventNumerics:
    """Search for the onset of an event."""

    fine: float = number(0.1, "time between points of a profile near its peak", unit="s")
    near: float = number(1.0, "half width of the fine part of a profile, and prior 1-sigma of a step", unit="s")
    coarse: float = number(0.5, "time between points of a profile elsewhere", unit="s")
    gust_step: float = number(0.2, "time between the onsets that are tried for a short gust of known size", unit="s")
    stays: float = number(0.02, "change of an onset below which it has converged", unit="s")
    helps: float = number(1.0, "smallest decrease of the deviance for which an onset is moved", unit="2 ln L")
    moves: int = number(6, "largest number of moves of an onset")
    trial_moves: int = number(2, "largest number of moves while a cause is tried")
    held_out_moves: int = number(2, "largest number of moves in held-out records")
    slow_polynomials: int = number(4, "Legendre polynomials of time that represent a slow change")


@dataclass(frozen=True, kw_only=True)
class NamingNumerics:
    """Number and kind of the causes that are fitted in each round."""

    rounds: int = number(6, "largest number of rounds")
    tentative: int = number(2, "rounds that may be refused until the named causes together explain what is missing")
    trials: int = number(4, "candidates of the first ranking that are fitted")
    further_trials: int = number(2, "candidates of each other ranking that are fitted")
    trial_iterations: int = number(8, "largest number of iterations of the fit of one more cause")
    terms: int = number(2, "terms of one coefficient that are fitted")
    equivalent_terms: int = number(4, "terms of one coefficient that are fitted if their predictions are equivalent")
    side_by_side: int = number(2, "trials that are fitted at a time; later ones are abandoned if they fall behind")
    rivals: int = number(2, "alternatives of a named cause that are fitted again")
    skew_step: float = number(0.1, "delay at which a skew is linearised, in sampling intervals")
    small_terms: int = number(5, "largest number of small terms that the verdict lists")
    ranking: int = number(40, "candidates that the result keeps")


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
        "derived: sampling rate recommended by Klein and Morelli, Aircraft System Identification, chapter 9",
    )
    fit: FitNumerics = FitNumerics()
    turbulence: TurbulenceNumerics = TurbulenceNumerics()
    missing_input: MissingInputNumerics = MissingInputNumerics()
    screening: ScreeningNumerics = ScreeningNumerics()
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()
