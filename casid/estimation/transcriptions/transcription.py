"""Represent the trajectory: one simulation, many short ones, or polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

from casid.arguments import number, numbers_by_name, require, whole
from casid.errors import EstimationError, InputError
from casid.estimation.cost import RangeWeights
from casid.estimation.noise import Huber, StudentT
from casid.estimation.problem import Problem
from casid.estimation.transcriptions.collocation import CONDENSED, LiftedCollocation
from casid.estimation.transcriptions.dynamics import Dynamics
from casid.estimation.transcriptions.layout import build_layout
from casid.estimation.transcriptions.shooting import Shooting
from casid.model.system import check_continuous

# of a record: nodes, and entries of a matrix (states, states) at each; a step takes a hundred bytes for each of these
_NODES = 20_000
_CELLS = 5_000_000
_STAGES = 3  # of Radau's method, as in Hairer and Wanner's RADAU5
_EXPLICIT_ORDER = 4  # of Runge and Kutta's method


class Transcription(Protocol):
    """Makes of a problem the segments that solvers work on. Any object with this method is a transcription."""

    def dynamics(self, problem: Problem) -> Dynamics:
        """The problem's motion on a layout. Raises EstimationError where it cannot represent the problem."""
        ...


@dataclass(frozen=True, kw_only=True)
class SingleShooting:
    """One simulation per record from its initial state.

    Attributes
    ----------
    substeps
        Steps per sample interval; None: as many as it takes, which `Fit.substeps` says.
    implicit
        Steps of Radau's method of fifth order, each solved by Newton's, instead of explicit ones of Runge and Kutta:
        for stiff motions, and for states that must not leave their range on the way.

    Raises
    ------
    InputError
        For a number of steps that is not whole or below one.

    Examples
    --------
    After the example of `solve`:

    >>> round(cs.solve(problem, cs.SingleShooting(substeps=1)).values["T"], 3)
    0.4
    """

    substeps: int | None = None
    implicit: bool = False
    process_noise: ClassVar[None] = None

    def __post_init__(self) -> None:
        _check_substeps(self.substeps, "SingleShooting")
        require(self.implicit, bool, "SingleShooting: implicit", "implicit=True")

    def dynamics(self, problem: Problem) -> Dynamics:
        """One segment per record.

        Raises
        ------
        EstimationError
            For sub-steps with a control law in the loop.
        """
        return _shooting(problem, self, None, {})


@dataclass(frozen=True, kw_only=True)
class MultipleShooting:
    """Simulations over `interval` samples each, tied by defects: the state at the end of one minus the next start.

    Attributes
    ----------
    interval
        Samples of each simulation.
    process_noise
        None: defects vanish at the solution. Otherwise name -> intensity, the standard deviation of the integrated
        noise after one second [unit * sqrt(s) of the quantity it drives]. A state's name is noise on its equation,
        a disturbance of the model enters through df/dw. Defects then are random with the covariance that this
        noise gains over the interval, and are paid for in the cost.
    substeps
        Steps per sample interval; None: as many as it takes, which `Fit.substeps` says.
    implicit
        As of SingleShooting.

    Raises
    ------
    InputError
        For an interval or a number of steps that is not whole or below one, or an intensity that is not positive.

    Examples
    --------
    After the example of `solve`:

    >>> fit = cs.solve(problem, cs.MultipleShooting(interval=20))
    >>> round(fit.values["T"], 3), fit.defect < 1e-8
    (0.4, True)
    """

    interval: int = 25
    process_noise: Mapping[str, float] | None = None
    substeps: int | None = None
    implicit: bool = False

    def __post_init__(self) -> None:
        _check_substeps(self.substeps, "MultipleShooting")
        require(self.implicit, bool, "MultipleShooting: implicit", "implicit=True")
        whole(self.interval, "MultipleShooting: interval (samples)")
        noise = {} if self.process_noise is None else self.process_noise
        for name, intensity in numbers_by_name(noise, "MultipleShooting: process_noise").items():
            number(intensity, f"MultipleShooting: process noise of '{name}'", positive=True)

    def dynamics(self, problem: Problem) -> Dynamics:
        """Segments of `interval` samples.

        Raises
        ------
        EstimationError
            For process noise without a given measurement noise, for sub-steps with a control law in the loop.
        InputError
            Where it drives what the model does not have.
        """
        noise = dict(self.process_noise or {})
        if noise and (problem.noise is None or isinstance(problem.noise, RangeWeights | StudentT | Huber | str)):
            raise EstimationError(
                "solve: with process noise the measurement noise cannot be read off the residuals; "
                "give Problem(noise={channel: 1-sigma, ...}) or its covariance"
            )
        if noise and self.implicit:
            raise EstimationError("solve: process noise takes explicit steps; leave implicit or process_noise out")
        return _shooting(problem, self, self.interval, noise)


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """Polynomials of `degree` over each step that satisfy the state equations at Gauss-Radau points.

    Attributes
    ----------
    degree
        Of the polynomials, 1 to 9.
    substeps
        Steps per sample interval; None: as many as it takes, which `Fit.substeps` says.

    Raises
    ------
    InputError
        For a degree or a number of steps out of range.

    Examples
    --------
    After the example of `solve`:

    >>> round(cs.solve(problem, cs.Collocation()).values["T"], 3)
    0.4
    """

    degree: int = 3
    substeps: int | None = None
    implicit: ClassVar[bool] = True
    process_noise: ClassVar[None] = None

    def __post_init__(self) -> None:
        _check_substeps(self.substeps, "Collocation")
        if whole(self.degree, "Collocation: degree") > 9:
            raise InputError(f"Collocation: degree is {self.degree}; expected 1 to 9")

    def dynamics(self, problem: Problem) -> Dynamics:
        """Segments of some samples, whose states are unknowns all the same.

        Raises
        ------
        EstimationError
            For a control law in the loop.
        InputError
            For a model in discrete time.
        """
        check_continuous(problem.model, "solve: Collocation, which represents a motion between samples,")
        if problem.feedback is not None:
            raise EstimationError(
                "solve: a digital control law in the loop jumps at the samples; use SingleShooting() or "
                "MultipleShooting()"
            )
        layout = build_layout(problem, CONDENSED, self.substeps or 1)
        return LiftedCollocation(problem.model, problem.free_index, layout, self.degree)


Stepping = SingleShooting | MultipleShooting | Collocation  # the transcriptions that choose their steps


def finest_interval(problem: Problem) -> int:
    """Return the samples between states for multiple shooting with a state at every sample: one, and more where the
    longest record would have more states than memory and time allow."""
    most = max(len(record) for record in problem.records)
    nodes = min(_NODES, max(_CELLS // max(len(problem.model.states), 1) ** 2, 1))
    return -(-most // nodes)


def as_stepping(method: Transcription) -> Stepping | None:
    """The transcription, if it is one that chooses its steps; None for one of a user's own."""
    return method if isinstance(method, Stepping) else None


def order_of(method: Stepping) -> int:
    """Return the power of the step with which the error of the integration falls."""
    degree = method.degree if isinstance(method, Collocation) else _STAGES
    return 2 * degree - 1 if method.implicit else _EXPLICIT_ORDER


def is_implicit(method: Transcription) -> bool:
    """Return True if every step of its integration is an equation."""
    return bool(getattr(method, "implicit", False))


def _check_substeps(substeps: int | None, where: str) -> None:
    if substeps is not None:
        whole(substeps, f"{where}: substeps")


def _shooting(
    problem: Problem, method: SingleShooting | MultipleShooting, interval: int | None, noise: dict[str, float]
) -> Dynamics:
    """Shooting over segments of `interval` samples, None: of whole records, whose steps may be those of Radau's
    method."""
    steps = method.substeps or 1
    if steps > 1:
        check_continuous(problem.model, "solve: substeps")
        if problem.feedback is not None:
            raise EstimationError(
                "solve: a control law acts once per sample, so substeps must be 1 with it in the loop"
            )
    layout = build_layout(problem, interval, steps)
    if not method.implicit:
        return Shooting(problem.model, problem.free_index, layout, noise, problem.feedback)
    check_continuous(problem.model, "solve: implicit steps")
    if problem.feedback is not None:
        raise EstimationError("solve: a digital control law in the loop takes explicit steps; leave implicit out")
    return LiftedCollocation(problem.model, problem.free_index, layout, _STAGES, lifted=False)
