"""How finely and how far the diagnosis looks: grids, breadths of a search, memory. More of it costs time."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.criterion import number


@dataclass(frozen=True, kw_only=True)
class FitNumerics:
    """Of a Gauss-Newton fit of a hypothesis."""

    shrink: float = number(0.4, "factor by which a step that leads nowhere is shortened")
    shortest_step: float = number(0.02, "part of a step below which a fit stops")
    promise: float = number(
        0.25, "part of what the step before promised, below which a step leads nearer to the maximum"
    )
    squares: float = number(1.01, "ratio of sums of squares within which such a step counts")
    relaxations: int = number(5, "fits in turbulence, each under the filter of the one before, at most")
    moved: float = number(0.5, "1-sigmas of a value, less than which ends these fits")
    far: float = number(
        100.0, "deviance per reading of an unconverged fit that is begun elsewhere", "derived: 10 sigmas"
    )
    outlier_fits: int = number(3, "fits until no outlier shows any more")
    wider: float = number(10.0, "times the noise under which it is begun elsewhere")
    noise_fits: int = number(2, "fits by which the noise of doubted channels is found")
    noise_iterations: int = number(6, "iterations of each of them")
    noise_tolerance: float = number(10.0, "drop of the deviance at which each of them ends", unit="2 ln L")
    noise_level_fits: int = number(8, "fits by which the level of doubted channels is found, at most")
    colour_fits: int = number(3, "fits by which their colour is found, at most")
    noise_stays: float = number(0.03, "relative change of their noise that ends these fits")
    states_iterations: int = number(6, "iterations of a fit of initial states alone")
    states_tolerance: float = number(1.0, "drop of the deviance at which it ends", unit="2 ln L")
    whiteness_lags: int = number(20, "lags of the Ljung-Box statistic")


@dataclass(frozen=True, kw_only=True)
class TurbulenceNumerics:
    """Of the search for the state of the air."""

    velocities: tuple[float, ...] = number((0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2), "r.m.s. velocities tried", unit="m/s")
    first_velocity: float = number(0.2, "velocity that is tried first", unit="m/s")
    worse: float = number(20.0, "rise of the deviance that ends the search along the velocity", unit="2 ln L")
    length_ratio: float = number(2.5, "ratio of the scale lengths that are tried")
    velocity_ratio: float = number(2.0, "ratio of the extreme velocities that are tried once the length is known")
    beyond: float = number(1.5, "steps of the grid from its middle that the peak of a parabola may be away")
    rolling: tuple[float, ...] = number(
        (0.3, 1.0, 3.0), "sizes of the air's own rolling that are tried, of MIL-F-8785C"
    )
    turning: tuple[float, float] = number(
        (-1.0, 1.0), "signs of the air's pitching and yawing by the gradient of its velocity, tried first", signed=True
    )
    repairs: int = number(3, "faults that are tried in the place of moving air, at most")


@dataclass(frozen=True, kw_only=True)
class MissingInputNumerics:
    """Of the unknown input at a station: nodes of its time history, and the sizes that are tried."""

    spacing: float = number(0.4, "time between nodes of a force or of moving air", unit="s")
    times: tuple[float, ...] = number((0.4, 1.5, 6.0), "correlation times of these", unit="s")
    drift_spacing: float = number(2.0, "time between nodes of a drifting reading", unit="s")
    drift_times: tuple[float, ...] = number((6.0, 20.0), "correlation times of it", unit="s")
    most_nodes: int = number(500, "nodes of all records together; longer records are looked at less finely")
    smallest_variance: float = number(1e-3, "variance tried first, in units of the best-determined direction")
    largest_variance: float = number(1e6, "variance tried last, in these units")
    variances: int = number(46, "variances tried, evenly over the logarithm")
    highest_frequency: float = number(0.4, "highest frequency of an oscillation, of the sampling rate")


@dataclass(frozen=True, kw_only=True)
class ScreeningNumerics:
    """Of the ranking of all causes at once."""

    columns: int = number(32, "columns that go back through the filter at a time: whole tiles of the compiled one")
    starts: int = number(4, "records from which sets of records grow")
    onset_step: float = number(1.0, "time between the onsets that are tried", unit="s")
    fine_up_to: float = number(30.0, "length of a record up to which onsets are that near", unit="s")
    longest_start: float = number(1.5, "largest predicted size from which a nonlinear effect is fitted, of that tried")
    responses: float = number(1.8e6, "numbers of whitened responses in memory together")
    fewest_responses: int = number(24, "responses in memory together, at least")
    most_responses: int = number(96, "responses in memory together, at most")
    steps_together: int = number(32, "onsets of jumps whose responses are in memory together")


@dataclass(frozen=True, kw_only=True)
class EventNumerics:
    """Of the search for the time at which an event sets in."""

    fine: float = number(0.1, "time between points of a profile near its peak", unit="s")
    near: float = number(1.0, "what is near to the peak, and 1-sigma of the prior of a step", unit="s")
    coarse: float = number(0.5, "time between points of a profile elsewhere", unit="s")
    gust_step: float = number(0.2, "time between onsets at which a short gust of known size shows", unit="s")
    stays: float = number(0.02, "move of an onset that is none", unit="s")
    helps: float = number(1.0, "drop of the deviance for which an onset moves", unit="2 ln L")
    moves: int = number(6, "moves of an onset at most")
    trial_moves: int = number(2, "moves of it while its cause is tried")
    held_out_moves: int = number(2, "moves of it in held-out records")
    slow_polynomials: int = number(4, "Legendre polynomials of time that make a slow change")


@dataclass(frozen=True, kw_only=True)
class NamingNumerics:
    """Of naming one cause after the other: how many, of which kind."""

    rounds: int = number(6, "rounds at most")
    tentative: int = number(2, "rounds that may pass until the named causes together explain what is missing")
    trials: int = number(4, "candidates of the first ranking that are tried")
    further_trials: int = number(2, "candidates of each other ranking that are tried")
    trial_iterations: int = number(8, "iterations of a fit of one more cause, at most")
    terms: int = number(2, "terms of one coefficient that are tried")
    equivalent_terms: int = number(4, "terms of one coefficient that are tried when they promise the same")
    side_by_side: int = number(2, "trials at a time; those after them are given up when they fall behind")
    rivals: int = number(2, "rivals of a named cause that are tried again")
    skew_step: float = number(0.1, "delay at which a skew is linearised, in sampling intervals")
    small_terms: int = number(5, "small terms that the verdict lists, at most")
    ranking: int = number(40, "candidates that the result keeps")


@dataclass(frozen=True, kw_only=True)
class ProbabilityNumerics:
    """Of the probabilities that are told."""

    reported: int = number(8, "explanations that are told")
    least: float = number(1e-4, "probability below which nothing is told of a cause")


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Resolution and breadth of every search."""

    fit: FitNumerics = FitNumerics()
    turbulence: TurbulenceNumerics = TurbulenceNumerics()
    missing_input: MissingInputNumerics = MissingInputNumerics()
    screening: ScreeningNumerics = ScreeningNumerics()
    events: EventNumerics = EventNumerics()
    naming: NamingNumerics = NamingNumerics()
