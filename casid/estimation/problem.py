"""The estimation problem: model, records, what is free, what is measured with which noise, what is known before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property

import casadi as ca
import numpy as np

from casid.arguments import listed, numbers_by_name, require
from casid.arguments import names as names_of
from casid.errors import EstimationError, InputError, unknown
from casid.estimation.checks import (
    check_constraints,
    check_feedback,
    check_function,
    check_initial_state,
    check_model,
    check_noise,
    check_of_records,
    check_records,
    check_spread,
    check_start,
    with_measured_states,
    with_prior,
)
from casid.estimation.constraints import Constraint, LinearConstraint, NonlinearConstraint, PathConstraint
from casid.estimation.cost import Cost, OutputError, OwnLikelihood, RangeWeights, check_cost, weights_of
from casid.estimation.initial_state import InitialState, of_record
from casid.estimation.noise import Huber, Noise, StudentT
from casid.model.built import share_cache
from casid.model.feedback import SampledFeedback
from casid.model.splines import cubic_inputs
from casid.model.system import Model, bare_name
from casid.model.with_effects import unseen_by_equations
from casid.records.given import given_records
from casid.records.record import Record

_WIDE = 30.0  # times the size of a state: moves an estimate by less than 1/30^2 of its standard error


@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """An estimation problem, independent of how it is transcribed and solved.

    Attributes
    ----------
    model
        Of the aircraft or any other system.
    records
        Flight records, one alone, or names of files.
    free
        Globs of model parameters to estimate, one value for all records.
    per_record
        Globs of model parameters to estimate with an own value per record, named "bias_q[m1]" in results.
    spread
        Per-record parameter -> typical size of how much it differs between records. Its values are then drawn from a
        normal distribution (of its logarithm, where it is in `log`), whose mean and spread are estimated. The size
        is the scale of a half-normal prior of the spread; infinite for none. `Fit.population` has what was found.
    fixed
        Values of parameters that are not estimated (it wins over the globs); all others stay nominal. A name with a
        record behind it, "dose[m1]", is of that record alone.
    log
        Globs of estimated parameters whose logarithm is what the solvers move: positive, of any order of magnitude.
        Values and errors are of the parameters themselves; a prior is then one of relative size.
    start
        Start values by name (a per-record name without brackets means every record); default: nominal.
    noise
        None: the 1-sigma of every measured channel is estimated along with the parameters. name -> 1-sigma: of every
        output, and of every equation, where the cost has any; for an output it may be the name of a channel of the
        records instead, with the 1-sigma of every sample, or a `Noise` by formula. RangeWeights(): weights by range
        (AIAA 2010-34, eq. 13).
        "full": noise of the outputs is correlated, its covariance is estimated along with the parameters. An array
        (outputs, outputs): that covariance, in the order of `model.outputs`.
    cost
        OutputError(), EquationError(), CombinedError() or one of your own.
    initial_state
        What is known of the initial states, see `InitialState`.
    prior
        True: `model.prior_std` about the nominal values, for the free parameters that have one. Or free parameter ->
        (mean, 1-sigma), which stand in the place of the model's; the mean is then its start too.
    constraints
        From `limit_parameter`, `limit_combination`, `limit_function`, `limit_trajectory`.
    measured
        State -> channel of the records that measures it, where that has another name than the state. Equation error and
        combined error take their states from there; it is also the first guess of the simulated states.
    feedback
        Digital control law in the loop: the records' inputs are then the commands that it adds to.

    Raises
    ------
    InputError
        For a name that does not exist, a value of the wrong kind and gaps in an input.
    EstimationError
        For a problem that cannot be estimated as posed.

    Examples
    --------
    The time constant, positive, from a known state at rest. After the example of `solve`:

    >>> problem = cs.Problem(
    ...     model=lag, records=[flown], free=["T"], noise={"y": 0.01}, constraints=[cs.limit_parameter("T", lower=0.0)],
    ...     initial_state=cs.InitialState(value={"x": 0.0}, std={"x": 0.0}),
    ... )
    >>> round(cs.solve(problem).values["T"], 3)
    0.4
    """

    model: Model
    records: Sequence[Record]
    _: KW_ONLY
    free: Sequence[str] = ()
    per_record: Sequence[str] = ()
    spread: Mapping[str, float] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    log: Sequence[str] = ()
    start: Mapping[str, float] = field(default_factory=dict)
    cost: Cost | OwnLikelihood = field(default_factory=OutputError)
    noise: Mapping[str, float | str | Noise] | RangeWeights | StudentT | Huber | np.ndarray | str | None = None
    prior: bool | Mapping[str, tuple[float, float]] = False
    constraints: Sequence[Constraint] = ()
    initial_state: InitialState = field(default_factory=InitialState)
    measured: Mapping[str, str] = field(default_factory=dict)
    feedback: SampledFeedback | None = None

    def __post_init__(self) -> None:
        check_model(self.model)
        given = given_records(self.records, "Problem")
        records = with_measured_states(self.model, tuple(map(self.model.ready, given)), self.measured)
        object.__setattr__(self, "records", records)
        for globs in ("free", "per_record", "log"):
            object.__setattr__(self, globs, names_of(getattr(self, globs), f"Problem: {globs}"))
        object.__setattr__(self, "constraints", check_constraints(self.constraints))
        check_cost(self.cost)
        check_records(self.model, records, simulated=self.simulated)
        own = [record.name for record in records]
        numbers_by_name(self.fixed, "Problem: fixed")
        check_of_records("fixed", self.fixed, "parameter", self.model.parameters, own)
        if not self.parameters and not self.simulated:
            raise EstimationError("Problem: no parameter is free; name some in free or per_record")
        if not isinstance(self.prior, bool):
            model = with_prior(self.model, self.prior, (*self.shared, *self.local))
            object.__setattr__(self, "model", share_cache(model, self.model))
            object.__setattr__(self, "prior", True)
        check_start(self.start, (*self.parameters, *self.model.parameters))
        require(self.initial_state, InitialState, "Problem: initial_state", "cs.InitialState(value={...}, std={...})")
        check_initial_state(self.model, self.initial_state, own)
        check_spread(self.spread, self.local, own)
        check_feedback(self.feedback, self.model)
        check_noise(self.noise, self.model)
        for constraint in self.constraints:
            self._check_constraint(constraint)
        _check_logarithmic(self)
        _check_combination(self)
        _check_formulas(self)
        _check_effects(self)
        if callable(check := getattr(self.cost, "check", None)):  # a cost may say what it does not take
            check(self)
        if self.model.histories:
            object.__setattr__(self, "records", tuple(map(self._with_histories, records, self.start_parameters)))

    def _with_histories(self, record: Record, parameters: np.ndarray) -> Record:
        """Make what effects make of a record at the start values."""
        return self.model.ready(record, dict(zip(self.model.parameters, parameters.tolist(), strict=True)))

    def __repr__(self) -> str:
        return (
            f"<Problem of '{self.model.name}': {self.cost!r}; records {listed(r.name for r in self.records)}; "
            f"free {listed(self.parameters)}>"
        )

    def _check_constraint(self, constraint: Constraint) -> None:
        if isinstance(constraint, LinearConstraint):
            for name in constraint.coefficients:
                if name not in self.parameters and name not in self.local:
                    raise unknown("free parameter", name, self.parameters, "Problem: constraint")
        elif isinstance(constraint, NonlinearConstraint):
            check_function(constraint, self.model, (*self.shared, *self.local))
        elif constraint.name not in (*self.model.states, *self.model.outputs):
            names = (*self.model.states, *self.model.outputs)
            raise unknown("state or output", constraint.name, names, "Problem: path constraint")
        elif not self.simulated:
            raise EstimationError("Problem: nothing is simulated here, so no path constraint can be put on it")

    @cached_property
    def weights(self) -> tuple[float, float]:
        """Weights of the output and of the equation part of the cost; the outputs of a model without states are its
        equations."""
        output, equation = weights_of(self.cost)
        return (output, equation) if self.model.states else (0.0, output + equation)

    @property
    def is_output_error(self) -> bool:
        """Return True if the cost is that of measured minus predicted outputs alone, as likelihood weighs them."""
        return weights_of(self.cost) == (1.0, 0.0)

    @property
    def simulated(self) -> bool:
        """Return True if a trajectory takes part in the cost."""
        return self.weights[0] > 0.0

    @cached_property
    def shared(self) -> tuple[str, ...]:
        """Free parameters with one value for all records, in the model's order."""
        names = chosen_parameters(self.free, self.model, "Problem: free")
        return tuple(n for n in names if n not in self._held and n not in self.local)

    @cached_property
    def local(self) -> tuple[str, ...]:
        """Free parameters with an own value per record, in the model's order."""
        return tuple(
            n for n in chosen_parameters(self.per_record, self.model, "Problem: per_record") if n not in self._held
        )

    @cached_property
    def _held(self) -> frozenset[str]:
        """Parameters that are fixed, in every record."""
        return frozenset(bare_name(self.model, name) for name in self.fixed)

    @cached_property
    def events(self) -> tuple[str, ...]:
        """Events of the model that happen in some record."""
        return tuple(name for name in self.model.events if any(record.events.get(name) for record in self.records))

    @cached_property
    def logarithmic(self) -> tuple[str, ...]:
        """Parameters of the model whose logarithm is estimated, in its order."""
        chosen = chosen_parameters(self.log, self.model, "Problem: log")
        return tuple(n for n in chosen if n in self.shared or n in self.local)

    @cached_property
    def sigma_channels(self) -> dict[str, str]:
        """Output -> channel with the 1-sigma of its samples."""
        given = self.noise if isinstance(self.noise, Mapping) else {}
        return {name: sigma for name, sigma in given.items() if isinstance(sigma, str)}

    @cached_property
    def noise_formulas(self) -> dict[str, Noise]:
        """Output -> noise by formula or log-normal."""
        given = self.noise if isinstance(self.noise, Mapping) else {}
        return {name: noise for name, noise in given.items() if isinstance(noise, Noise)}

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all unknown parameters: the shared ones, then those of each record."""
        own = tuple(f"{name}[{record.name}]" for record in self.records for name in self.local)
        return self.shared + own

    @cached_property
    def free_index(self) -> np.ndarray:
        """(free,) index in model.parameters of what one record sees as free: shared, then local."""
        order = {name: i for i, name in enumerate(self.model.parameters)}
        return np.array([order[n] for n in self.shared + self.local], dtype=int)

    def columns(self, record: int) -> np.ndarray:
        """(free,) where the free parameters of a record, by its position, are in `parameters`; as `free_index`."""
        return self._columns[record]

    @cached_property
    def _columns(self) -> np.ndarray:
        shared = len(self.shared)
        local = len(self.local)
        own = shared + np.arange(len(self.records) * local).reshape(len(self.records), local)
        return np.concatenate([np.tile(np.arange(shared), (len(self.records), 1)), own], axis=1)

    @cached_property
    def bare(self) -> tuple[str, ...]:
        """Names in the model of all unknown parameters, in the order of `parameters`."""
        return self.shared + self.local * len(self.records)

    @cached_property
    def nominal(self) -> np.ndarray:
        """(parameters,) a-priori value of every unknown."""
        return np.array([self.model.nominal[name] for name in self.bare])

    @cached_property
    def start_vector(self) -> np.ndarray:
        """(parameters,) start values."""
        pairs = zip(self.parameters, self.bare, self.nominal, strict=True)
        return np.array([self.start.get(n, self.start.get(b, value)) for n, b, value in pairs], dtype=float)

    @cached_property
    def prior_std(self) -> np.ndarray:
        """(parameters,) a-priori 1-sigma; infinite where there is none."""
        known = self.model.prior_std if self.prior else {}
        return np.array([known.get(name, np.inf) for name in self.bare])

    @cached_property
    def by_logarithm(self) -> np.ndarray:
        """(parameters,) whether the logarithm of an unknown is estimated."""
        return np.array([name in self.logarithmic for name in self.bare], dtype=bool)

    def named(self, theta: np.ndarray) -> dict[str, float]:
        """Name -> value of all unknown parameters, of theta (parameters,)."""
        return dict(zip(self.parameters, theta.tolist(), strict=True))

    def model_parameters(self, theta: np.ndarray) -> np.ndarray:
        """(records, model parameters) values that each record is simulated with, of free ones as in `parameters`."""
        values = self._known.copy()
        values[:, self.free_index] = theta[self._columns]
        return values

    @cached_property
    def start_parameters(self) -> np.ndarray:
        """(records, model parameters) values that each record is simulated with at the start."""
        return self.model_parameters(self.start_vector)

    @cached_property
    def _known(self) -> np.ndarray:
        """(records, model parameters) values of what is not free."""
        return np.array([self.model.nominal_vector(self.fixed_in(record.name)) for record in self.records])

    def fixed_in(self, record: str) -> dict[str, float]:
        """Parameter -> value of what is fixed in a record, or in all if there is none of the name."""
        return of_record(self.fixed, record)

    @cached_property
    def initial_knowledge(self) -> tuple[np.ndarray, np.ndarray]:
        """(records, states) value of the initial states, NaN where nothing is known, and its 1-sigma, 0 if exact.

        A 1-sigma that is not given is wide: many times the largest magnitude of the state's readings or guess in any
        record, so that a motion within the readings is moved by less than a thousandth of its standard error.
        """
        known, given = self._initial_given
        if not np.isnan(given).any():
            return known, given
        size = np.maximum(self.guessed_size, np.abs(np.nan_to_num(known)).max(axis=0))
        return known, np.where(np.isnan(given), _WIDE * size, given)

    @cached_property
    def _initial_given(self) -> tuple[np.ndarray, np.ndarray]:
        """(records, states) value and 1-sigma of the initial states as they are given, NaN where they are not."""
        states = self.model.states
        tables = [self.initial_state.of(record.name) for record in self.records]
        rows = [[[table.get(s, np.nan) for s in states] for table in both] for both in tables]
        known, given = np.reshape(rows, (len(tables), 2, len(states))).astype(float).transpose(1, 0, 2)
        return known, given

    @cached_property
    def is_initial_weak(self) -> np.ndarray:
        """(records, states) whether the 1-sigma of the initial state is so wide that it is no knowledge."""
        known, std = self.initial_knowledge
        return std >= (1.0 - 1e-9) * _WIDE * np.maximum(self.guessed_size, np.abs(np.nan_to_num(known)))

    @cached_property
    def state_size(self) -> np.ndarray:
        """(states,) order of magnitude of each state: of its readings where it is measured, else the larger one of what
        the model states and of the guess."""
        read = [any(s in r and np.isfinite(r[s]).any() for r in self.records) for s in self.model.states]
        rounded = 10.0 ** np.round(np.log10(self.guessed_size))  # the same for all records of one experiment
        return np.where(read, rounded, np.maximum(rounded, self.model.scale_vector()))

    @cached_property
    def guessed_size(self) -> np.ndarray:
        """(states,) largest magnitude of readings or guess in any record; where these are zero, that of the model."""
        size = np.zeros(len(self.model.states))
        for record in self.records:
            guess = np.asarray(self.model.guess(record), dtype=float)
            size = np.maximum(size, np.abs(guess, where=np.isfinite(guess), out=np.zeros_like(guess)).max(axis=0))
        return np.where(size > 0.0, size, self.model.scale_vector())

    @cached_property
    def is_initial_given(self) -> np.ndarray:
        """(records, states) whether the problem states a 1-sigma of the initial state."""
        return ~np.isnan(self._initial_given[1])

    def at_guess(self, expression: ca.SX) -> list[np.ndarray]:
        """Record by record (N, rows) a column of the model's symbols along the guessed states, at the start values and
        without disturbances."""
        model = self.model
        function = ca.Function("at_guess", [model.x, model.u, model.p, model.w], [ca.densify(expression)])
        calm = np.zeros(len(model.disturbances))
        return [
            function(model.guess(record).T, record.matrix(model.inputs).T, p, calm).full().T
            for record, p in zip(self.records, self.start_parameters, strict=True)
        ]

    def outputs_of(self, record: Record) -> np.ndarray:
        """(N, outputs) measured outputs of one of the records, NaN where missing."""
        missing = np.full(len(record), np.nan)
        columns = [record.channels.get(name, missing) for name in self.model.outputs]
        return np.stack(columns, axis=1)

    @cached_property
    def linear_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(rows, lower, upper) of the linear constraints on the vector of parameters."""
        linear = [c for c in self.constraints if isinstance(c, LinearConstraint)]
        kept = [(row, c.lower, c.upper) for c in linear for row in self.linear_rows_of(c)]
        rows, lower, upper = zip(*kept, strict=True) if kept else ((), (), ())
        return np.reshape(rows, (len(kept), len(self.parameters))), np.array(lower), np.array(upper)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, parameters) lower and upper limits of each parameter alone; infinite where it has none."""
        low = np.full(len(self.parameters), -np.inf)
        high = np.full(len(self.parameters), np.inf)
        for row, lower, upper in zip(*self.linear_rows, strict=True):
            which = np.flatnonzero(row)
            if len(which) == 1:
                ends = sorted((lower / row[which[0]], upper / row[which[0]]))
                low[which[0]] = max(low[which[0]], ends[0])
                high[which[0]] = min(high[which[0]], ends[1])
        return np.stack([low, high])

    def linear_rows_of(self, constraint: LinearConstraint) -> list[np.ndarray]:
        """The rows (parameters,) of one constraint: one, or one for every record where it has per-record parameters."""
        per_record = any(name in self.local for name in constraint.coefficients)
        rows = []
        for record in self.records if per_record else self.records[:1]:
            row = np.zeros(len(self.parameters))
            for name, coefficient in constraint.coefficients.items():
                full = f"{name}[{record.name}]" if name in self.local else name
                row[self.parameters.index(full)] += coefficient
            rows.append(row)
        return rows

    @property
    def path_constraints(self) -> tuple[PathConstraint, ...]:
        """The constraints on states and outputs."""
        return tuple(c for c in self.constraints if isinstance(c, PathConstraint))


def chosen_parameters(globs: Sequence[str], model: Model, where: str) -> tuple[str, ...]:
    """Parameters of the model that any of the globs matches, in its order. Raises InputError for one that matches none,
    with `where` it is from."""
    chosen = set()
    for glob in globs:
        found = [name for name in model.parameters if name == glob or fnmatchcase(name, glob)]
        if not found:
            raise unknown("parameter", glob, model.parameters, where)
        chosen.update(found)
    return tuple(name for name in model.parameters if name in chosen)


def check_plain(problem: Problem, what: str) -> None:
    """Raise EstimationError for a problem that is posed in other coordinates than those that `what` knows."""
    for found, words in (
        (problem.logarithmic, "parameters by their logarithm"),
        (problem.model.initial, "initial states by formula"),
        (problem.sigma_channels, "noise per sample"),
        (problem.events, "events"),
        (problem.spread, "parameters drawn from a distribution"),
    ):
        if found:
            raise EstimationError(f"{what}: {words} ({', '.join(found)}) is not taken here; pose the problem without")


def _check_logarithmic(problem: Problem) -> None:
    """Raise EstimationError for a logarithm of what may not be positive."""
    for name in problem.logarithmic:
        if not problem.model.nominal[name] > 0.0:
            raise EstimationError(
                f"Problem: log: the a-priori value of '{name}' is {problem.model.nominal[name]:g}; expected a positive "
                "one"
            )
    for (name, value), by_log in zip(problem.named(problem.start_vector).items(), problem.by_logarithm, strict=True):
        if by_log and not value > 0.0:
            raise EstimationError(f"Problem: log: the start of '{name}' is {value:g}; expected a positive value")
    own = set(problem.parameters) - set(problem.shared)
    for constraint in problem.constraints:
        coefficients = constraint.coefficients if isinstance(constraint, LinearConstraint) else {}
        for name in coefficients if len(coefficients) > 1 else ():
            if name in own and bare_name(problem.model, name) in problem.logarithmic:
                raise EstimationError(
                    f"Problem: '{name}' of one record is estimated by its logarithm and stands in a sum with others; "
                    "estimate it as it is, without log"
                )


def _check_combination(problem: Problem) -> None:
    """Raise EstimationError for what has no meaning together, InputError for what the records do not have."""
    model = problem.model
    law = problem.feedback is not None
    by_equations = problem.weights[1] > 0.0
    cubic = cubic_inputs(model, problem.records)
    if model.period is not None and cubic:
        raise InputError(
            f"Problem: model '{model.name}' is in discrete time; its inputs cannot be cubic between samples"
        )
    for is_wrong, why in (
        (
            isinstance(problem.noise, str | np.ndarray) and problem.weights != (1.0, 0.0),
            "correlated noise is that of simulated outputs alone; equations take noise per channel",
        ),
        (
            isinstance(problem.noise, StudentT | Huber) and model.states and by_equations,
            "robust noise is that of simulated outputs; use OutputError()",
        ),
        (
            problem.events and (law or by_equations),
            f"events ({', '.join(problem.events)}) are those of a simulation, without a control law in the loop; use "
            "OutputError()",
        ),
        (
            law and (model.initial or problem.sigma_channels or problem.logarithmic),
            "a control law in the loop was made for the model as it is; it takes no `initial` of the model, no noise "
            "per sample and no log",
        ),
        (law and cubic, "a control law holds what it commands; its inputs cannot be cubic between samples"),
        (
            model.initial and all(w > 0.0 for w in problem.weights),
            "the model's `initial` holds simulated states, and the equation part of CombinedError takes measured ones; "
            "use OutputError()",
        ),
        (
            problem.sigma_channels and model.states and by_equations,
            "noise per sample is that of outputs; equations take one 1-sigma per channel",
        ),
    ):
        if is_wrong:
            raise EstimationError(f"Problem: {why}")
    for name, channel in problem.sigma_channels.items():
        if name not in model.outputs:
            raise unknown("output", name, model.outputs, "Problem: noise")
        for record in problem.records:
            _check_sigma(record, name, channel)
    for constraint in problem.path_constraints:
        if constraint.name in model.initial or constraint.name in problem.sigma_channels:
            raise EstimationError(
                f"Problem: a path constraint on '{constraint.name}', which has an initial value by formula or a noise "
                "per sample; put it on an output of its own"
            )


def _check_effects(problem: Problem) -> None:
    """Raise EstimationError for effects that the equations of a cost do not have."""
    if not problem.weights[1] > 0.0 or not problem.model.states:
        return
    unseen = unseen_by_equations(problem.model)
    acting = [n for n in unseen if n in problem.shared + problem.local or problem.model.nominal.get(n, 0.0) != 0.0]
    if acting:
        raise EstimationError(
            f"Problem: {', '.join(acting)} cannot act in the equations, which take the measured signals as they are; "
            "use OutputError()"
        )


def _check_formulas(problem: Problem) -> None:
    """Raise InputError or EstimationError for noise by formula that cannot be as it is posed."""
    formulas = problem.noise_formulas
    model = problem.model
    if not formulas:
        return
    if problem.feedback is not None or (model.states and problem.weights != (1.0, 0.0)):
        raise EstimationError("Problem: noise by formula is that of OutputError(), without a control law in the loop")
    for name, noise in formulas.items():
        if name not in model.outputs:
            raise unknown("output", name, model.outputs, "Problem: noise")
        noise.expression(model, name)
        for record in problem.records:
            reading = record[name] if name in record else np.zeros(0)
            if noise.logarithmic and (reading <= 0.0).any():
                k = int(np.flatnonzero(reading <= 0.0)[0])
                raise InputError(
                    f"record '{record.name}': '{name}' is {reading[k]:g} at t = {record.t[k]:g} s; readings with "
                    "log-normal noise are positive: leave it out, or take normal noise"
                )
            if isinstance(noise.sigma, str) and noise.sigma not in record:
                raise unknown("channel", noise.sigma, record.channels, f"record '{record.name}': noise of '{name}'")
    for constraint in problem.path_constraints:
        if constraint.name in formulas:
            raise EstimationError(
                f"Problem: a path constraint on '{constraint.name}', whose noise is a formula; put it on an output of "
                "its own"
            )


def _check_sigma(record: Record, name: str, channel: str) -> None:
    if channel not in record:
        raise unknown("channel", channel, record.channels, f"record '{record.name}': noise of '{name}'")
    if name in record:
        bad = np.flatnonzero(np.isfinite(record[name]) & ~(record[channel] > 0.0))
        if len(bad):
            raise InputError(
                f"record '{record.name}': '{channel}', the 1-sigma of '{name}', is {record[channel][bad[0]]:g} at "
                f"t = {record.t[bad[0]]:g} s; expected a positive number"
            )
