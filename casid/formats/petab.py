"""Estimation problems of PEtab (version 1), the format of the systems biology benchmark collection.

Schmiester et al., PLOS Computational Biology 17 (2021) e1008646, and petab.readthedocs.io: an SBML model, and tables of
conditions, observables, measurements and parameters. Every condition becomes a record, which has the readings at the
times of measurement, and as inputs what changes at known times.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import a_path
from casid.errors import EstimationError, InputError, unknown
from casid.estimation.constraints import limit_parameter
from casid.estimation.noise import Noise
from casid.estimation.problem import Problem
from casid.formats.sbml import SbmlModel, Scope, Switch, parsed, read_sbml, translated
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.records.record import Record

Row = Mapping[str, str]
_TIME = "t"
_KINDS = ("observable", "noise")


def read_petab(path: str | Path) -> Problem:
    """The estimation problem of a PEtab file.

    Parameters
    ----------
    path
        The YAML file of one problem in version 1. The SBML model and the tables stand beside it.

    Returns
    -------
    Problem
        A record for every condition and, where a time was read more than once, for every replicate. It starts at the
        nominal values of the parameter table; bounds are constraints, scales are logarithms. Noise formulas, log-normal
        noise, conditions on time and events at known times are taken as they are.

    Raises
    ------
    InputError
        For a file that cannot be read, and for a name, a formula or an event that is not taken.
    EstimationError
        For pre-equilibration, steady states as measurements, Laplace noise and priors other than normal ones.

    Examples
    --------
    >>> fit = cs.solve(cs.read_petab("Boehm_JProteomeRes2014.yaml"))  # doctest: +SKIP
    """
    file = a_path(path, "read_petab")
    tables = _Tables.read(file)
    return _Reading(tables).problem()


@dataclass(frozen=True, eq=False, kw_only=True)
class _Tables:
    """The files of a problem: rows by table, and the model."""

    file: Path
    sbml: SbmlModel
    conditions: list[Row]
    observables: list[Row]
    measurements: list[Row]
    parameters: list[Row]

    @classmethod
    def read(cls, file: Path) -> _Tables:
        """All files that the YAML file names."""
        try:
            import yaml
        except ImportError:
            raise InputError(f"{file}: PEtab needs PyYAML; install it with: pip install 'casid[petab]'") from None
        try:
            content = yaml.safe_load(file.read_text(encoding="utf-8"))
            problems, named = content["problems"], content["parameter_file"]
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
            fault = str(error).splitlines()[0]
            raise InputError(f"{file}: not a PEtab problem of version 1: {fault}") from None
        if len(problems) != 1 or len(problems[0].get("sbml_files", ())) != 1:
            raise InputError(f"{file}: expected one problem with one SBML file")
        (one,), folder = problems, file.parent

        def rows(key: str) -> list[Row]:
            return [row for name in one.get(key, ()) for row in _rows(folder / name)]

        return cls(
            file=file,
            sbml=read_sbml(folder / one["sbml_files"][0]),
            conditions=rows("condition_files"),
            observables=rows("observable_files"),
            measurements=rows("measurement_files"),
            parameters=[r for name in ([named] if isinstance(named, str) else named) for r in _rows(folder / name)],
        )


def _rows(path: Path) -> list[Row]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return [{k: (v or "").strip() for k, v in r.items() if k} for r in csv.DictReader(file, delimiter="\t")]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


class _Reading:
    """A problem while it is put together."""

    def __init__(self, tables: _Tables) -> None:
        self.tables, self.where = tables, str(tables.file)
        self.table = {row["parameterId"]: row for row in tables.parameters}
        self.free = [n for n, row in self.table.items() if row.get("estimate", "1") in ("1", "1.0", "true")]
        self.nominal = {n: _value(row, "nominalValue", self.where) for n, row in self.table.items()}
        self.conditions = {row["conditionId"]: row for row in tables.conditions}
        self.observables = {row["observableId"]: row for row in tables.observables}
        self.literal: dict[str, str] = {}  # placeholder -> the one thing that it stands for
        self.sampled: dict[str, list[str]] = {}  # placeholder -> parameters for which it stands in some samples
        for kind in _KINDS:
            for name in self.observables:
                self._placeholders(kind, name)
        self._overrides()
        self.values = {**tables.sbml.constants, **self.added, **self.nominal}
        self.switches: dict[str, Switch] = {}
        self.timed = False
        self._discover()

    # ---- what stands for what

    def _placeholders(self, kind: str, observable: str) -> None:
        rows = [row for row in self.tables.measurements if row["observableId"] == observable]
        entries = [_entries(row, kind) for row in rows]
        for i in range(max(map(len, entries), default=0)):
            name = f"{kind}Parameter{i + 1}_{observable}"
            if any(len(entry) <= i for entry in entries):
                raise InputError(f"{self.where}: {name} has no entry in some measurements")
            own = {entry[i] for entry in entries}
            if len(own) == 1:
                self.literal[name] = own.pop()
            else:
                self.sampled[name] = sorted(entry for entry in own if _number(entry) is None)

    def _overrides(self) -> None:
        """Columns of the condition table: numbers are values of a record, names weigh parameters."""
        sbml, self.added, self.named = self.tables.sbml, {}, {}
        columns = [n for n in (self.tables.conditions or [{}])[0] if n not in ("conditionId", "conditionName")]
        for column in columns:
            if column not in (*sbml.constants, *sbml.states, *self.table):
                raise unknown("name", column, (*sbml.constants, *sbml.states), f"{self.where}: condition table")
            entries = {row[column] for row in self.tables.conditions if row[column]}
            names = sorted(entry for entry in entries if _number(entry) is None)
            self.named[column] = names
            if column in sbml.states:
                self.added[f"initial {column}"] = 0.0
            self.added |= {f"{column} is {name}": 0.0 for name in names}

    def _fixed(self, condition: str) -> dict[str, float]:
        """Values of a condition by name."""
        row, states, found = self.conditions[condition], self.tables.sbml.states, {}
        for column, names in self.named.items():
            entry, target = row[column], f"initial {column}" if column in states else column
            number = _number(entry) if entry else self._default(column)
            found[target] = 0.0 if number is None else number
            found |= {f"{column} is {name}": float(name == entry) for name in names}
        return found

    def _default(self, column: str) -> float:
        value = self.tables.sbml.initial.get(column, self.values.get(column))
        if not isinstance(value, int | float):
            raise InputError(f"{self.where}: condition table: '{column}' has no entry, and its value is a formula")
        return float(value)

    # ---- expressions

    def scope(self, known: Mapping[str, Any]) -> Scope:
        """Names as the formulas of the tables and of the model mean them."""
        symbols = {n: v for n, v in known.items() if isinstance(v, ca.SX)}
        plain = dict(symbols)
        for column, names in self.named.items():
            if column not in self.tables.sbml.states and names:
                symbols[column] = plain[column] + sum(plain[f"{column} is {n}"] * plain[n] for n in names)
        for name, parts in self.sampled.items():
            if name in plain:
                symbols[name] = plain[name] + sum((plain[f"{name} is {n}"] * plain[n] for n in parts), ca.SX(0))
        rules = {**self.tables.sbml.rules, **{n: parsed(text, self.where) for n, text in self.literal.items()}}
        inputs = {n: plain[n] for n in self.switches if n in plain}
        return Scope(where=self.where, known=symbols, rules=rules, inputs=inputs)

    def _rates(self, s: Any) -> dict[str, ca.SX]:
        return dict(self.tables.sbml.rates(self.scope(vars(s))))

    def _events(self, s: Any) -> dict[str, dict[str, ca.SX]]:
        scope, doses = self.scope(vars(s)), self.tables.sbml.doses
        return {n: {state: translated(f, scope) for state, f in sets.items()} for n, (_, sets) in doses.items()}

    def _outputs(self, s: Any) -> dict[str, ca.SX]:
        scope = self.scope(vars(s))
        return {n: translated(parsed(r["observableFormula"], self.where), scope) for n, r in self.observables.items()}

    def _initial(self, s: Any) -> dict[str, ca.SX]:
        known, sbml = dict(vars(s)), self.tables.sbml
        scope = self.scope(known)
        scope.rules = {**scope.rules, **sbml.initial}
        found = {}
        for state in sbml.states:
            found[state] = translated(sbml.initial[state], scope)
            if state in self.named:
                parts = (known[f"{state} is {n}"] * known[n] for n in self.named[state])
                found[state] = known[f"initial {state}"] + sum(parts, ca.SX(0))
        return found

    def _discover(self) -> None:
        """The conditions on time of the model, and whether time stands anywhere else."""
        sbml = self.tables.sbml
        names = (*self.values, *sbml.states, *self._sample_channels(), _TIME)
        symbols = {name: ca.SX.sym(name) for name in names}
        free = ca.vertcat(*(symbols[n] for n in (*self.free, *sbml.states)))

        class Space:
            def __init__(self) -> None:
                self.__dict__.update(symbols)

        scope = self.scope(symbols)
        for trigger, sets in sbml.doses.values():
            for formula in (trigger, *sets.values()):
                translated(formula, scope)
        sbml.rates(scope)
        self.switches = {n: s for n, s in scope.switches.items() if not ca.depends_on(s.margin, free)}
        symbols |= {name: ca.SX.sym(name) for name in self.switches}
        everything = [*self._rates(Space()).values(), *self._outputs(Space()).values()]
        self.timed = bool(everything) and ca.depends_on(ca.vertcat(*everything), symbols[_TIME])
        self._margins = {
            name: ca.Function("margin", [symbols[_TIME], *(symbols[n] for n in self.values)], [switch.margin])
            for name, switch in self.switches.items()
        }

    def _sample_channels(self) -> list[str]:
        return [c for n, parts in self.sampled.items() for c in (n, *(f"{n} is {p}" for p in parts))]

    def _noise(self, name: str) -> Any:
        """Noise of an observable, as `Problem` takes it."""
        row = self.observables[name]
        kind, scale = row.get("noiseDistribution") or "normal", row.get("observableTransformation") or "lin"
        if kind != "normal":
            raise EstimationError(
                f"{self.where}: noise of '{name}' is {kind}; only normal and log-normal noise is taken"
            )
        logarithmic, factor = scale != "lin", math.log(10.0) if scale == "log10" else 1.0
        formula = row["noiseFormula"]
        literal = self.literal.get(formula, formula)
        if _number(literal) is not None:
            sigma = factor * float(literal)
            return Noise(sigma=sigma, logarithmic=True) if logarithmic else sigma
        if self.sampled.get(formula) == [] and factor == 1.0:
            return Noise(sigma=formula, logarithmic=True) if logarithmic else formula
        tree = parsed(formula, self.where)
        return Noise(sigma=lambda s: factor * translated(tree, self.scope(vars(s))), logarithmic=logarithmic)

    # ---- numbers

    def _records(self) -> list[Record]:
        if any(row.get("preequilibrationConditionId") for row in self.tables.measurements):
            raise EstimationError(f"{self.where}: conditions with pre-equilibration are not taken")
        found = []
        for condition in dict.fromkeys(row["simulationConditionId"] for row in self.tables.measurements):
            if condition not in self.conditions:
                raise unknown("condition", condition, self.conditions, f"{self.where}: measurements")
            rows = [row for row in self.tables.measurements if row["simulationConditionId"] == condition]
            for i, replicate in enumerate(_replicates(rows)):
                found.append(self._record(condition if i == 0 else f"{condition}, {i + 1}", condition, replicate))
        return found

    def _record(self, name: str, condition: str, rows: Sequence[Row]) -> Record:
        times = np.array([_value(row, "time", self.where) for row in rows])
        if not np.isfinite(times).all():
            raise EstimationError(f"{self.where}: steady states as measurements are not taken")
        values = [{**self.values, **self._fixed(condition)}[n] for n in self.values]
        changes = {n: self._time_of(n, values) for n in self._margins}
        doses = {n: self._time_of(self._trigger(n), values) for n in self.tables.sbml.doses}
        last = float(times.max())
        within = [t for t in changes.values() if 0.0 < t < last]
        grid = np.unique(np.concatenate([[0.0], times, within]))
        if len(grid) < 2:
            grid = np.array([0.0, 1.0])
        channels: dict[str, np.ndarray] = {n: np.full(len(grid), np.nan) for n in self.observables}
        for row, k in zip(rows, np.searchsorted(grid, times), strict=True):
            channels[row["observableId"]][k] = _value(row, "measurement", self.where)
        middle = 0.5 * (grid + np.append(grid[1:], 2.0 * grid[-1] - grid[-2]))
        for switch, margin in self._margins.items():
            channels[switch] = np.array([float(margin(t, *values)) >= 0.0 for t in middle], dtype=float)
        channels |= self._samples(grid, rows)
        held = {n: "held" for n in channels if n not in self.observables}
        events = {dose: [t] for dose, t in doses.items() if 0.0 < t <= last}
        return Record(name=name, t=grid, channels=channels, hold=held or "linear", source=self.where, events=events)

    def _trigger(self, event: str) -> str:
        """The switch that is the trigger of an event."""
        symbols = {name: ca.SX.sym(name) for name in (*self.values, *self.tables.sbml.states, _TIME)}
        scope = self.scope(symbols)
        translated(self.tables.sbml.doses[event][0], scope)
        if len(scope.switches) != 1 or (name := next(iter(scope.switches))) not in self.switches:
            raise InputError(f"{self.where}: event '{event}' is not at a known time; only such events are taken")
        return name

    def _time_of(self, switch: str, values: Sequence[float]) -> float:
        """When a condition on time changes, in a record; infinite where it never does."""
        margin = self._margins[switch]
        at = [float(margin(t, *values)) for t in (0.0, 1.0, 2.0)]
        if not math.isclose(at[2] - at[1], at[1] - at[0], rel_tol=1e-9, abs_tol=1e-12):
            raise InputError(f"{self.where}: '{switch}' is not linear in time; only such conditions are taken")
        return -at[0] / (at[1] - at[0]) if at[1] != at[0] else math.inf

    def _samples(self, grid: np.ndarray, rows: Sequence[Row]) -> dict[str, np.ndarray]:
        """Channels of what differs between measurements: the entry of the next measurement, or of the last."""
        channels: dict[str, np.ndarray] = {}
        for name, parts in self.sampled.items():
            head, _, observable = name.partition("_")
            kind, index = head.split("Parameter")

            def entries_of(some: Sequence[Row], own: str = observable, kind: str = kind, k: int = int(index) - 1):
                chosen = [row for row in some if row["observableId"] == own]
                return sorted((_value(row, "time", self.where), _entries(row, kind)[k]) for row in chosen)

            own = entries_of(rows) or entries_of(self.tables.measurements)
            which = np.minimum(np.searchsorted([t for t, _ in own], grid), len(own) - 1)
            entries = [own[k][1] for k in which]
            channels[name] = np.array([_number(e) or 0.0 for e in entries])
            channels |= {f"{name} is {p}": np.array([float(e == p) for e in entries]) for p in parts}
        return channels

    # ---- the problem

    def problem(self) -> Problem:
        """All of it."""
        records, sbml = self._records(), self.tables.sbml
        inputs = [*self._sample_channels(), *self.switches]
        model = define_model(
            sbml.name,
            states=sbml.states,
            inputs=[*inputs, *([_TIME] if self.timed else [])],
            parameters=self.values,
            outputs=list(self.observables),
            dynamics=self._rates,
            output=self._outputs,
            initial=self._initial,
            prior_std=self._priors(),
            events=self._events,
        )
        conditions = [record.name.partition(", ")[0] for record in records]
        fixed = {
            f"{n}[{record.name}]": value
            for record, condition in zip(records, conditions, strict=True)
            for n, value in self._fixed(condition).items()
        }
        log = [n for n in self.free if self.table[n].get("parameterScale", "lin") in ("log", "log10")]
        found = Problem(
            _sized(model, records, fixed),
            records,
            free=self.free,
            fixed={**fixed},
            log=log,
            start={n: self.nominal[n] for n in self.free},
            noise={name: self._noise(name) for name in self.observables},
            constraints=list(self._bounds()),
            prior=bool(model.prior_std),
        )
        return found

    def _bounds(self) -> Iterable[Any]:
        for name in self.free:
            sides = (_number(self.table[name].get(side, "")) for side in ("lowerBound", "upperBound"))
            low, high = (s if s is not None and math.isfinite(s) else None for s in sides)
            if low is not None or high is not None:
                yield limit_parameter(name, lower=low, upper=high)

    def _priors(self) -> dict[str, float]:
        """1-sigma of normal priors about the nominal value; on a logarithmic scale one of relative size."""
        found = {}
        for name in self.free:
            row = self.table[name]
            kind = row.get("objectivePriorType", "")
            if kind in ("", "uniform", "parameterScaleUniform"):
                continue
            mean, std = (float(part) for part in row["objectivePriorParameters"].split(";"))
            if kind not in ("normal", "parameterScaleNormal"):
                raise EstimationError(f"{self.where}: the prior of '{name}' is {kind}; only normal ones are taken")
            base = {"log10": math.log(10.0), "log": 1.0}.get(row.get("parameterScale", "lin"), 0.0)
            if kind == "normal" and base:
                raise EstimationError(f"{self.where}: '{name}' has a normal prior and is estimated by its logarithm")
            value = math.exp(mean * base) if base else mean
            self.values[name] = value
            found[name] = std * base * value if base else std
        return found


def _entries(row: Row, kind: str) -> list[str]:
    return [part.strip() for part in row.get(f"{kind}Parameters", "").split(";") if part.strip()]


def _replicates(rows: Sequence[Row]) -> list[list[Row]]:
    """The measurements in groups that read every observable at most once at a time."""
    seen: dict[tuple[str, float], int] = {}
    groups: list[list[Row]] = []
    for row in rows:
        key = (row["observableId"], float(row["time"]))
        seen[key] = seen.get(key, -1) + 1
        if seen[key] == len(groups):
            groups.append([])
        groups[seen[key]].append(row)
    return groups


def _value(row: Row, column: str, where: str) -> float:
    number = _number(row.get(column, ""))
    if number is None:
        raise InputError(f"{where}: column '{column}' has {row.get(column, 'nothing')!r:.30}; expected a number")
    return number


def _sized(model: Model, records: Sequence[Record], fixed: Mapping[str, float]) -> Model:
    """The model with the sizes that its states have at the nominal values, by CVODES."""
    sizes = dict.fromkeys(model.states, 0.0)
    for record in records:
        own = {n.partition("[")[0]: v for n, v in fixed.items() if n.endswith(f"[{record.name}]")}
        p = model.nominal_vector(own)
        begin = ca.Function("begin", [model.p], [ca.vertcat(*(model.initial[s] for s in model.states))])
        try:
            states = simulate(model, record, begin(p).full()[:, 0], own, integrator="cvodes").states
        except InputError:  # no motion at the nominal values: sizes as they are
            continue
        for i, name in enumerate(model.states):
            sizes[name] = max(sizes[name], float(np.abs(states[:, i]).max()))
    return replace(model, state_scale={n: size if size > 0.0 else 1.0 for n, size in sizes.items()})
