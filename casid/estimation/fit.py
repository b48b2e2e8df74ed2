"""Hold the result of an estimation: parameters with their errors, addressed by name, and the fit of the data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.above import ask_above
from casid.errors import unknown
from casid.estimation.fitted import ChannelFit, Estimate, Population, Starts, StateHistory
from casid.estimation.problem import Problem
from casid.estimation.remarks import jump_remarks, remarks
from casid.estimation.solvers.status import Results, Status
from casid.estimation.uncertainty import Rescaled, Uncertainty
from casid.estimation.usable import Judgement, judge
from casid.frames import Rows, html_list, html_paragraph
from casid.keeping import plain, save

if TYPE_CHECKING:
    from pandas import DataFrame

    from casid.model.simulate import Simulation
    from casid.records.record import Record


# of an estimate: its head in a table, and its format
_COLUMNS = {
    "value": ("value", ".6g"),
    "std": ("std", ".3g"),
    "std_cramer_rao": ("Cramer-Rao", ".3g"),
    "prior": ("a priori", ".6g"),
    "prior_std": ("a-priori std", ".3g"),
}
# what estimate.json has of the attributes as they are
_IN_JSON = (
    "status reason remedy converged iterations method solver seconds cost log_likelihood log_prior log_posterior "
    "stationarity defect parameters initial_states noise channels remarks"
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Fit:
    """Result of `solve`.

    Attributes
    ----------
    values
        Name -> estimate; a per-record one is named "bias_q[m1]"; `parameters` has them with their errors.
    uncertainty
        The standard errors, computed when they are asked for.
    ended
        How the solution ended: `result`, `reason` and `remedy` are its parts, `status` is it in words.
    cost
        1/2 sum of squares of all weighted residuals, priors included, at the final weights.
    prior_cost
        Its part of the priors, and of process noise where there is any.
    log_likelihood
        Of the residuals under normal noise of `noise_covariance`, without priors. At an end that is no solution, with
        open defects or too few steps, it is that of one motion from its initial states, integrated anew, and so are the
        predictions; not a number where that departs, with a remark.
    log_prior
        ln of the normal densities of what has a prior: parameters, and initial states with a 1-sigma.
    noise
        Channel -> 1-sigma that the weights imply (range weights: what the residuals show).
    noise_covariance
        (channels, channels) likewise, with their correlations where those are considered.
    stationarity
        Length of a further Gauss-Newton step in standard deviations of the solution.
    defect
        Largest scaled state defect, zero but for rounding where defects are hard.
    process_noise
        Disturbance -> 1-sigma and correlation time [s] of the noise that drives it, 0 for white; of `FilterError`.
    innovations
        Record -> (N, channels) residuals over their standard deviation, white at the truth, 0 where not measured;
        likewise.
    predictions, residuals
        Record -> (N, channels) in the order of `channels`; residual = measured - predicted, NaN where not measured.
    states
        Record -> StateHistory; empty for equation error.
    multipliers
        One per limit on parameters, in the order of the problem's constraints and positive at an upper limit. A
        constraint with per-record parameters has one for every record. For the path see `path_multipliers`.
    solver
        The one that finished: "GaussNewton", "Newton" or "Ipopt"; iterations are those of all.
    method, substeps, implicit
        The transcription, its steps per sample interval and whether shooting took implicit ones: those that were taken
        where `solve` was free to choose.
    starts
        How many of several starts ended where; None where there was one.
    population
        Per-record parameter -> the distribution over records, where `Problem.spread` asked for one.
    way
        Further solver or transcription that was needed to reach this result, "" if none was; `remarks` begin with it.

    Examples
    --------
    After the example of `solve`:

    >>> fit.converged, round(fit.values["T"], 3), fit.residuals["flown"].shape
    (True, 0.4, (200, 1))
    """

    problem: Problem
    values: dict[str, float]
    uncertainty: Uncertainty | Rescaled
    ended: Status
    iterations: int
    seconds: float
    cost: float
    prior_cost: float
    log_likelihood: float
    log_prior: float
    stationarity: float
    defect: float
    noise: Mapping[str, float]
    noise_covariance: np.ndarray
    channels: Mapping[str, ChannelFit]
    predictions: Mapping[str, np.ndarray]
    residuals: Mapping[str, np.ndarray]
    states: Mapping[str, StateHistory]
    multipliers: np.ndarray
    method: str
    solver: str
    substeps: int = 1
    implicit: bool = False
    process_noise: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    innovations: Mapping[str, np.ndarray] = field(default_factory=dict)
    starts: Starts | None = None
    population: Mapping[str, Population] = field(default_factory=dict)
    way: str = ""

    @property
    def path_multipliers(self) -> tuple[dict[str, np.ndarray], ...]:
        """One table per path limit, in the order of the problem's constraints: record -> (N,).

        Positive where an upper limit holds a sample, negative where a lower one does, else zero. The sum over all
        samples is the rate at which the cost falls as the limit is raised. A soft limit holds no sample.
        """
        problem = self.problem
        pressed = self.uncertainty.solved.pressed
        names = [record.name for record in problem.records]
        if pressed is None:
            pressed = [np.zeros((len(problem.path_constraints), len(record.t))) for record in problem.records]
        return tuple(
            {name: of_record[i] for name, of_record in zip(names, pressed, strict=True)}
            for i in range(len(problem.path_constraints))
        )

    @property
    def log_posterior(self) -> float:
        """Sum of `log_likelihood` and `log_prior`, by which fits of one problem compare."""
        return self.log_likelihood + self.log_prior

    @property
    def result(self) -> Results:
        """Return how the solution ended, of an enumeration whose values state what to do about it."""
        return self.ended.result

    @property
    def reason(self) -> str:
        """Why it did not converge, with names and numbers; "" where it did."""
        return self.ended.reason

    @property
    def remedy(self) -> str:
        """Return what to do about that; "" where nothing is wrong."""
        if self.converged:
            return ""
        return self.ended.remedy or self.result.value

    @property
    def status(self) -> str:
        """ "converged", or result, reason and remedy in words."""
        return self.ended.text

    @property
    def converged(self) -> bool:
        """Return True if the point is a checked stationary point that satisfies the constraints."""
        return self.ended.converged

    @cached_property
    def judgement(self) -> Judgement:
        """Judgement whether the estimates can be used, with the reasons."""
        return judge(self)

    @property
    def verdict(self) -> str:
        """ "usable", "structure missing", "not identifiable" or "not converged"."""
        return self.judgement.verdict

    @property
    def because(self) -> tuple[str, ...]:
        """The reasons for the verdict; those of "usable" are what to mind."""
        return self.judgement.because

    @property
    def integrator(self) -> str:
        """Return the method of integration, in words; "" where nothing was simulated."""
        if not self.states:
            return ""
        kind = "implicit (Radau collocation)" if self.method == "Collocation" else "explicit (Runge-Kutta)"
        kind = "implicit (Radau)" if self.implicit else kind
        return f"{kind}, {self.substeps} step{'s' * (self.substeps != 1)} per sample interval"

    @property
    def covariance(self) -> np.ndarray:
        """(parameters, parameters) Cramer-Rao, in the order of `parameters`."""
        return self.uncertainty.covariance

    @property
    def covariance_corrected(self) -> np.ndarray:
        """(parameters, parameters) with the colour of the residuals."""
        return self.uncertainty.corrected

    @cached_property
    def parameters(self) -> dict[str, Estimate]:
        """name -> Estimate."""
        every = (self.uncertainty.honest, self.covariance, self.covariance_corrected)
        std, cramer_rao, corrected = (np.sqrt(np.maximum(np.diagonal(c), 0.0)) for c in every)
        below, above = self.uncertainty.sides
        prior = self.problem.nominal
        prior_std = self.problem.prior_std
        low, high = self.problem.bounds
        return {
            name: Estimate(
                name=name,
                value=value,
                std=float(std[i]),
                std_cramer_rao=float(cramer_rao[i]),
                std_corrected=float(corrected[i]),
                interval=(
                    min(max(value - float(below[i]), float(low[i])), value),
                    max(min(value + float(above[i]), float(high[i])), value),
                ),
                prior=float(prior[i]),
                prior_std=float(prior_std[i]),
            )
            for i, (name, value) in enumerate(self.values.items())
        }

    @cached_property
    def initial_states(self) -> dict[str, dict[str, Estimate]]:
        """Record -> state -> Estimate of its value at the first sample, with the prior that `InitialState` gave (not a
        number and infinite where it gave none: the data alone decide). A state that the model's `initial` gives is no
        estimate and not listed."""
        errors = self.uncertainty.initial_std
        posed = self.problem
        found: dict[str, dict[str, Estimate]] = {}
        for r, record in enumerate(posed.records if self.states else ()):
            value, std = posed.initial_state.of(record.name)
            first = dict(zip(posed.model.states, self.states[record.name].nodes[0].tolist(), strict=True))
            found[record.name] = {}
            for i, name in enumerate(posed.model.states):
                if name in posed.model.initial and name not in std:
                    continue
                bound, corrected = (math.nan, math.nan) if errors is None else errors[:, r, i].tolist()
                reach = self.uncertainty.quantile * max(bound, corrected)
                found[record.name][name] = Estimate(
                    name=f"{name}[{record.name}]",
                    value=first[name],
                    std=max(bound, corrected),
                    std_cramer_rao=bound,
                    std_corrected=corrected,
                    interval=(first[name] - reach, first[name] + reach),
                    prior=value.get(name, math.nan),
                    prior_std=std.get(name, math.inf),
                )
        return found

    def __getitem__(self, name: str) -> Estimate:
        if name not in self.parameters:
            raise unknown("parameter", name, self.parameters, "fit")
        return self.parameters[name]

    def correlation(self, first: str, second: str) -> float:
        """Correlation of the errors of two parameters; raises InputError for a name that was not estimated."""
        names = list(self.parameters)
        i = names.index(self[first].name)
        j = names.index(self[second].name)
        return float(self.correlations[i, j])

    @property
    def correlations(self) -> np.ndarray:
        """(parameters, parameters) correlation matrix; zero off the diagonal for a parameter without variance."""
        std = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))  # rounding may leave less than nothing
        outer = np.outer(std, std)
        with np.errstate(invalid="ignore", divide="ignore"):
            matrix = np.where(outer > 0, self.covariance / outer, np.where(np.isnan(outer), np.nan, 0.0))
        np.fill_diagonal(matrix, 1.0)
        return matrix

    def to_dict(self) -> dict[str, Any]:
        """The content of estimate.json: plain numbers, lists and texts; a number that does not exist is None."""
        return {
            "schema": "casid.estimate/2",
            "verdict": self.verdict,
            "because": list(self.because),
            "model": self.problem.model.name,
            "result": self.result.name.lower(),
            "estimator": type(self.problem.cost).__name__,
            "records": [record.name for record in self.problem.records],
            **plain(self, _IN_JSON),
            "correlation": {"names": list(self.parameters), "matrix": plain(self.correlations)},
            **({"process_noise": _process_noise(self)} if self.process_noise else {}),
            **({"population": plain(self.population)} if self.population else {}),
        }

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """List what a person should know besides the status, a sentence each: a channel whose mean explains it
        better, a parameter three a-priori deviations from the file or of the opposite sign, an input that jumps
        between samples and would explain the data better held."""
        found = remarks(self)
        found = (self.way, *found) if self.way else found
        solved = self.uncertainty.solved
        if not self.converged or solved.linear is None:
            return found
        return (*found, *jump_remarks(solved.objective, solved.linear.point.theta))

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {
            "remarks": self.remarks,
            "judgement": self.judgement,
        }  # what they are made of is not kept

    def plot(self, record: str | None = None) -> Any:
        """Measured and predicted channels of a record, by name; default the first.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`. Raises InputError for a
        record that was not fitted.
        """
        return ask_above("Fit.plot", self, record)

    def predict(self, record: Record | str | Path, *, window_s: float = 5.0) -> Simulation:
        """Open-loop simulation of a record, which the fit may never have seen, with the estimates.

        The initial state is fitted to the first `window_s` seconds of what the record measures. Parameters of single
        records keep their a-priori value in a record that was not fitted. Raises InputError for a record that lacks an
        input and for a motion that diverges.

        Parameters
        ----------
        record
            A record, or the name of its file.
        window_s
            Time from the start that determines the initial state [s].
        """
        return ask_above("Fit.predict", self, record, window_s)

    def save(self, path: str | Path) -> None:
        """Write it whole into a file, for `casid.load`; see `casid.keeping` for what that is good for."""
        save(self, path)

    def to_frame(self) -> DataFrame:
        """Estimates as a pandas data frame, a row for each parameter; needs the extra `pandas`."""
        return self.rows().frame()

    def to_latex(self) -> str:
        """Estimates as a LaTeX table, for the package booktabs."""
        return self.rows().latex()

    def rows(self) -> Rows:
        """Estimates as rows: a priori, estimated, with both standard deviations."""
        return Rows(
            heads={"parameter": "", **{head: form for head, form in _COLUMNS.values()}},
            keys={head: key for key, (head, _) in _COLUMNS.items()},
            rows=[(n, *(getattr(one, key) for key in _COLUMNS)) for n, one in self.parameters.items()],
        )

    def _of_channels(self) -> Rows:
        return Rows(
            heads={"channel": "", "rms": ".4g", "R2": ".5f", "Theil": ".4f", "samples": "d"},
            rows=[(n, c.rms, c.R2, c.theil, c.samples) for n, c in self.channels.items()],
        )

    def _over_records(self) -> Rows:
        rows = []
        for name, one in self.population.items():
            shown = f"ln {name}" if one.logarithmic else name
            rows.append((shown, one.mean, one.mean_std, one.spread, *one.interval))
        heads = {"over records": "", "mean": ".6g", "std": ".3g", "spread": ".3g", "from": ".3g", "to (95 %)": ".3g"}
        return Rows(heads=heads, rows=rows)

    def _repr_html_(self) -> str:
        head = f"{self.problem.model.name}: {type(self.problem.cost).__name__}, {self.method}, {self.solver}"
        told = f"{self.status}; {self.iterations} iterations, ln(likelihood) {self.log_likelihood:.8g}"
        return (
            html_paragraph(self.verdict, "; ".join(self.because))
            + html_paragraph(head, told)
            + html_list(one for one in self.remarks if one not in self.because)
            + self.rows().html()
            + self._of_channels().html()
        )

    def __repr__(self) -> str:
        worst = min(self.channels, key=lambda n: self.channels[n].R2, default="")
        least = f"; least R2 {self.channels[worst].R2:.3g} ({worst})" if worst else ""
        said = f"; {len(self.remarks)} remarks" if self.remarks else ""
        return (
            f"<Fit of '{self.problem.model.name}': {self.status}; {len(self.values)} parameters{least}{said}; "
            "print it for the numbers>"
        )

    def __str__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Status, remarks, estimates and channels as text."""
        head = "\n".join((self.verdict, *(f"  {one}" for one in self.because)))
        head += (
            f"\n{self.problem.model.name}: {type(self.problem.cost).__name__}, {self.method}, {self.solver}\n"
            f"{self.status}; {self.iterations} iterations, {self.seconds:.3g} s\n"
            f"ln(likelihood) {self.log_likelihood:.8g}, cost {self.cost:.6g}"
        )
        head += f"\n{self.integrator}" if self.integrator else ""
        head += f"\n{self.starts!r}" if self.starts is not None else ""
        lines = [head, *(f"! {remark}" for remark in self.remarks if remark not in self.because), ""]
        tables = (self.rows(), self._over_records(), self._of_channels())
        return "\n".join([*lines, "\n\n".join(one.text() for one in tables if one.rows)])


def _process_noise(fit: Fit) -> dict[str, dict[str, float]]:
    return {n: {"sigma": sigma, "correlation_time_s": tau} for n, (sigma, tau) in fit.process_noise.items()}
