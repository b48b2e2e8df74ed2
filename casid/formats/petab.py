"""Estimation problems of PEtab (version 1), the format of the systems biology benchmark collection.

Schmiester et al., PLOS Computational Biology 17 (2021) e1008646, and petab.readthedocs.io: an SBML model, and tables of
conditions, observables, measurements and parameters. Every condition becomes a record, which has the readings at the
times of measurement, and as inputs what changes at known times.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from casid.arguments import a_path
from casid.errors import EstimationError, InputError, check_known, unknown
from casid.estimation.constraints import limit_parameter
from casid.estimation.noise import Noise
from casid.estimation.problem import Problem
from casid.formats.petab_tables import Row, Tables
from casid.formats.sbml import Scope, Switch, parsed, translated
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.records.record import Record

_TIME = "t"
_KINDS = ("observable", "noise")
_BEGIN = "simulation begins"  # the event at t = 0 where another condition came before it
_REST = 1e-8  # relative accuracy of a motion that comes to rest
_DOUBLINGS = 40  # of a time, from a unit of it on, in which it has to


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
        noise, conditions on time and events at known times are taken as they are. Pre-equilibration is the part of a
        record before t = 0, and a reading at infinity the end of its record. Observables that nobody read are left out.

    Raises
    ------
    InputError
        For a file that cannot be read, and for a name, a formula or an event that is not taken.
    EstimationError
        For Laplace noise, priors other than normal ones, and a steady state that the nominal motion does not reach.

    Examples
    --------
    >>> fit = cs.solve(cs.read_petab("Boehm_JProteomeRes2014.yaml"))  # doctest: +SKIP
    """
    file = a_path(path, "read_petab")
    try:
        return _Reading(Tables.read(file)).problem()
    except RecursionError:
        raise InputError(f"{file}: formulas refer to each other in a circle; every name needs a value") from None


_NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf(inity)?|nan)", re.ASCII | re.IGNORECASE)


def _number(text: str) -> float | None:
    return float(text) if _NUMBER.fullmatch(text) else None


_ESTIMATED = ("1", "1.0", "true", "True")
_SCALES = ("lin", "log", "log10", "")
_SHAPES = ("normal", "laplace", "uniform", "logNormal", "logLaplace")
_SHAPES += ("parameterScaleNormal", "parameterScaleLaplace", "parameterScaleUniform")
# table and column -> the words that PEtab 1 has for it
_WORDS = {
    ("parameters", "estimate"): (*_ESTIMATED, "0", "0.0", "false", "False"),
    ("parameters", "parameterScale"): _SCALES,
    ("parameters", "objectivePriorType"): (*_SHAPES, ""),
    ("parameters", "initializationPriorType"): (*_SHAPES, ""),
    ("observables", "observableTransformation"): _SCALES,
    ("observables", "noiseDistribution"): ("normal", "laplace", ""),
}


class _Reading:
    """A problem while it is put together."""

    def __init__(self, tables: Tables) -> None:
        self.tables, self.where = tables, str(tables.file)
        self.table = {row["parameterId"]: row for row in tables.parameters}
        self._check_words()
        self.free = [n for n, row in self.table.items() if row.get("estimate", "1") in _ESTIMATED]
        self.nominal = {n: _value(row, "nominalValue", self.where) for n, row in self.table.items()}
        self.conditions = {row["conditionId"]: _without_nan(row) for row in tables.conditions}
        every = {row["observableId"]: row for row in tables.observables}
        self.pairs: dict[tuple[str, str], list[Row]] = {}  # conditions before and after t = 0 -> measurements
        for row in tables.measurements:
            self._check_measurement(row, every)
            pair = row.get("preequilibrationConditionId", ""), row["simulationConditionId"]
            self.pairs.setdefault(pair, []).append(row)
        if not self.pairs:
            raise InputError(f"{self.where}: no measurement")
        measured = {row["observableId"] for row in tables.measurements}
        self.observables = {name: row for name, row in every.items() if name in measured}
        self.literal: dict[str, str] = {}  # placeholder -> its one meaning
        self.sampled: dict[str, list[str]] = {}  # placeholder -> parameters that it means in some samples
        for kind in _KINDS:
            for name in self.observables:
                self._placeholders(kind, name)
        self._overrides()
        self.values = {**tables.sbml.constants, **self.added, **self.nominal}
        self._check_references()
        self.conditions_of: dict[str, tuple[str, str]] = {}  # record -> conditions before and after t = 0
        self.switches: dict[str, Switch] = {}
        self.timed = False
        self._discover()

    def _check_words(self) -> None:
        """Every word of a table is one of PEtab."""
        for (name, column), words in _WORDS.items():
            for word in {row.get(column, words[0]) for row in getattr(self.tables, name)} - {*words}:
                raise unknown(f"{column} of {name}", word, [one for one in words if one], self.where)

    def _check_measurement(self, row: Row, observables: Collection[str]) -> None:
        where = f"{self.where}: measurements"
        check_known("observable", (row["observableId"],), observables, where)
        before = row.get("preequilibrationConditionId", "")
        after = row["simulationConditionId"]
        check_known("condition", (after, before) if before else (after,), self.conditions, where)
        _value(row, "time", where)
        _value(row, "measurement", where)

    def _check_references(self) -> None:
        """Names behind columns and placeholders are parameters."""
        named = {n for names in (*self.named.values(), *self.sampled.values()) for n in names}
        for name in sorted(named - set(self.values)):
            raise unknown("parameter", name, self.values, f"{self.where}: conditions and measurements")

    # ---- what stands for what

    def _placeholders(self, kind: str, observable: str) -> None:
        entries = [_entries(row, kind) for row in _of_observable(self.tables.measurements, observable)]
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
        """Columns of the condition table: numbers are values of a record, names weigh parameters. What another
        condition holds before t = 0 than after it is an input as well, and a state that it sets jumps there."""
        sbml = self.tables.sbml
        self.added = {}
        self.named = {}
        columns = [n for n in (self.tables.conditions or [{}])[0] if n not in ("conditionId", "conditionName")]
        self.changing: dict[str, list[str]] = {}  # column -> channels: its value, and a weight of each name
        self.reset = [
            c for c in columns if c in sbml.states and any(p and self.conditions[s][c] for p, s in self.pairs)
        ]
        for column in columns:
            if column not in (*sbml.constants, *sbml.states, *self.table):
                raise unknown("name", column, (*sbml.constants, *sbml.states), f"{self.where}: condition table")
            entries = {row[column] for row in self.conditions.values() if row[column]}
            names = sorted(entry for entry in entries if _number(entry) is None)
            self.named[column] = names
            if column in sbml.states:
                self.added[f"initial {column}"] = 0.0
            self.added |= {f"{column} is {name}": 0.0 for name in names}
            if column in self.reset:
                self.added |= {f"{column} jumps": 0.0, f"later {column}": 0.0}
                self.added |= {f"later {column} is {name}": 0.0 for name in names}
            elif any(p and self.conditions[p][column] != self.conditions[s][column] for p, s in self.pairs):
                self.changing[column] = [f"{column} now", *(f"{column} is {name} now" for name in names)]

    def _fixed(self, condition: str) -> dict[str, float]:
        """Values of a condition by name."""
        row = self.conditions[condition]
        states = self.tables.sbml.states
        found = {}
        for column, names in self.named.items():
            entry = row[column]
            target = f"initial {column}" if column in states else column
            number = _number(entry) if entry else self._default(column)
            found[target] = 0.0 if number is None else number
            found |= {f"{column} is {name}": float(name == entry) for name in names}
        return found

    def _jumps(self, before: str, after: str) -> dict[str, float]:
        """Values with which states are set at t = 0, after another condition."""
        found = {}
        for column in self.reset:
            entry = self.conditions[after][column] if before else ""
            found |= {f"{column} jumps": float(bool(entry)), f"later {column}": _number(entry) or 0.0}
            found |= {f"later {column} is {name}": float(name == entry) for name in self.named[column]}
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
            if column in self.tables.sbml.states or column not in plain:
                continue
            now = " now" if f"{column} now" in plain else ""
            symbols[column] = _weighed(plain, f"{column}{now}", [f"{column} is {n}{now}" for n in names], names)
        for name, parts in self.sampled.items():
            if name in plain:
                symbols[name] = _weighed(plain, name, [f"{name} is {n}" for n in parts], parts)
        rules = {**self.tables.sbml.rules, **{n: parsed(text, self.where) for n, text in self.literal.items()}}
        inputs = {n: plain[n] for n in self.switches if n in plain}
        return Scope(where=self.where, known=symbols, rules=rules, inputs=inputs)

    def _rates(self, s: Any) -> dict[str, ca.SX]:
        return dict(self.tables.sbml.rates(self.scope(vars(s))))

    def _events(self, s: Any) -> dict[str, dict[str, ca.SX]]:
        known = vars(s)
        doses = self.tables.sbml.doses
        scope = self.scope(known)
        found = {n: {state: translated(f, scope) for state, f in sets.items()} for n, (_, sets) in doses.items()}
        if self.reset:
            found[_BEGIN] = {}
        for state in self.reset:
            names = self.named[state]
            later = _weighed(known, f"later {state}", [f"later {state} is {n}" for n in names], names)
            found[_BEGIN][state] = known[state] + known[f"{state} jumps"] * (later - known[state])
        return found

    def _outputs(self, s: Any) -> dict[str, ca.SX]:
        scope = self.scope(vars(s))
        return {n: translated(parsed(r["observableFormula"], self.where), scope) for n, r in self.observables.items()}

    def _initial(self, s: Any) -> dict[str, ca.SX]:
        known = dict(vars(s))
        sbml = self.tables.sbml
        scope = self.scope(known)
        scope.rules = {**scope.rules, **sbml.initial}
        found = {}
        for state in sbml.states:
            found[state] = translated(sbml.initial[state], scope)
            if state in self.named:
                names = self.named[state]
                found[state] = _weighed(known, f"initial {state}", [f"{state} is {n}" for n in names], names)
        return found

    def _discover(self) -> None:
        """The conditions on time of the model, and whether time occurs anywhere else."""
        sbml = self.tables.sbml
        now = [channel for channels in self.changing.values() for channel in channels]
        names = (*self.values, *sbml.states, *self._sample_channels(), *now, _TIME)
        symbols = {name: ca.SX.sym(name) for name in names}
        free = ca.vertcat(*(symbols[n] for n in (*self.free, *sbml.states)))

        scope = self.scope(symbols)
        for trigger, sets in sbml.doses.values():
            for formula in (trigger, *sets.values()):
                translated(formula, scope)
        sbml.rates(scope)
        self.switches = {n: s for n, s in scope.switches.items() if not ca.depends_on(s.margin, free)}
        symbols |= {name: ca.SX.sym(name) for name in self.switches}
        rates = self._rates(SimpleNamespace(**symbols))
        outputs = self._outputs(SimpleNamespace(**symbols))
        everything = [*rates.values(), *outputs.values()]
        self.timed = bool(everything) and ca.depends_on(ca.vertcat(*everything), symbols[_TIME])
        self.given = [*self.values, *now]  # of what a condition gives
        given = ca.vertcat(*(symbols[n] for n in self.given))
        self._margins = {
            name: ca.Function("margin", [symbols[_TIME], given], [switch.margin])
            for name, switch in self.switches.items()
        }
        states = ca.vertcat(*(symbols[n] for n in sbml.states))
        driven = [symbols[n] for n in self.switches]
        slope = ca.vertcat(*(rates[n] for n in sbml.states))
        everywhere = [states, given, ca.vertcat(*driven), symbols[_TIME]]
        self._slope = ca.Function("slope", everywhere, [slope, ca.densify(ca.jacobian(slope, states))])
        begin = self._initial(SimpleNamespace(**{n: symbols[n] for n in self.values}))
        self._begin = ca.Function("begin", [given], [ca.vertcat(*(begin[n] for n in sbml.states))])

    def _sample_channels(self) -> list[str]:
        return [c for n, parts in self.sampled.items() for c in (n, *(f"{n} is {p}" for p in parts))]

    def _noise(self, name: str) -> Any:
        """Noise of an observable, as `Problem` takes it."""
        row = self.observables[name]
        kind = row.get("noiseDistribution") or "normal"
        scale = row.get("observableTransformation") or "lin"
        if kind != "normal":
            raise EstimationError(
                f"{self.where}: noise of '{name}' is {kind}; only normal and log-normal noise is taken"
            )
        logarithmic = scale != "lin"
        factor = math.log(10.0) if scale == "log10" else 1.0
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
        found = []
        for (before, after), rows in self.pairs.items():
            name = f"{after} after {before}" if before else after
            for i, replicate in enumerate(_replicates(rows)):
                record = self._record(name if i == 0 else f"{name}, {i + 1}", (before, after), replicate)
                self.conditions_of[record.name] = before, after
                found.append(record)
        return found

    def _record(self, name: str, pair: tuple[str, str], rows: Sequence[Row]) -> Record:
        """Time is zero where the second condition begins; the first lasts until it is at rest, before that. A reading
        at infinity is one at rest after the last finite time."""
        before, after = pair
        times = np.array([_value(row, "time", self.where) for row in rows])
        finite = times[np.isfinite(times)]
        if (finite < 0.0).any() or not (times > -math.inf).all():
            raise InputError(f"{self.where}: measurements: time {times.min()}; expected zero, later, or inf")
        own = {**self.values, **self._fixed(before or after), **self._jumps(before, after)}
        values = [{**own, **self._now(after)}[n] for n in self.given]
        changes = {n: self._time_of(n, values) for n in self._margins}
        doses = {n: self._time_of(self._trigger(n), values) for n in self.tables.sbml.doses}
        last = float(finite.max(initial=0.0))
        within = [t for t in changes.values() if 0.0 < t < last]
        lead = self._until_rest([{**own, **self._now(before)}[n] for n in self.given], 0.0) if before else np.zeros(0)
        rest = np.zeros(0)
        if len(finite) < len(times):
            rest = last + self._until_rest(values, max([last, *(t for t in doses.values() if t < math.inf)]))
        grid = np.unique(np.concatenate([-lead, [0.0], finite, within, rest]))
        if len(grid) < 2:
            grid = np.array([0.0, 1.0])
        channels: dict[str, np.ndarray] = {n: np.full(len(grid), np.nan) for n in self.observables}
        for row, k in zip(rows, np.searchsorted(grid, np.minimum(times, grid[-1])), strict=True):
            channels[row["observableId"]][k] = _value(row, "measurement", self.where)
        middle = 0.5 * (grid + np.append(grid[1:], 2.0 * grid[-1] - grid[-2]))
        for switch, margin in self._margins.items():
            channels[switch] = np.array([float(margin(t, values)) >= 0.0 for t in middle], dtype=float)
        for channel, value in self._now(after).items():
            first = self._now(before)[channel] if before else value
            channels[channel] = np.where(grid < 0.0, first, value)
        channels |= self._samples(grid, rows)
        held = {n: "held" for n in channels if n not in self.observables}
        events = {dose: [t] for dose, t in doses.items() if 0.0 < t <= grid[-1]}
        if before and self.reset:
            events[_BEGIN] = [0.0]
        return Record(name=name, t=grid, channels=channels, hold=held or "linear", source=self.where, events=events)

    def _now(self, condition: str) -> dict[str, float]:
        """Channels of what differs before and after t = 0, in a condition."""
        fixed = self._fixed(condition) if self.changing else {}
        return {
            channel: fixed[channel.removesuffix(" now")] for channels in self.changing.values() for channel in channels
        }

    def _until_rest(self, values: Sequence[float], begin: float) -> np.ndarray:
        """Times in twos from the beginning of a motion at the nominal values until it has come to rest, and as long
        again, for other values."""
        if self.timed:
            raise EstimationError(f"{self.where}: a steady state of a model with time in its equations is not taken")
        switches = [float(margin(begin + 1e-9, values)) >= 0.0 for margin in self._margins.values()]

        def slope(part: int, x: np.ndarray) -> np.ndarray:
            return self._slope(x, values, switches, begin)[part].full()

        until = 1.0
        x = self._begin(values).full()[:, 0]
        for _ in range(_DOUBLINGS):
            with np.errstate(all="ignore"):  # a motion that grows leaves the numbers, as is looked at below
                found = solve_ivp(
                    lambda _, x: slope(0, x)[:, 0],
                    (0.0, until),
                    x,
                    "BDF",
                    jac=lambda _, x: slope(1, x),
                    rtol=_REST,
                    atol=_REST * _REST,
                )
            if not found.success or not np.isfinite(found.y).all():
                break
            former = x
            x = found.y[:, -1]
            if (np.abs(x - former) <= 10.0 * _REST * np.maximum(np.abs(x), _REST * np.abs(x).max(initial=0.0))).all():
                return until * 2.0 ** np.arange(-_DOUBLINGS // 2, 2.0)
            until *= 2.0
        raise EstimationError(
            f"{self.where}: the motion does not come to rest at the nominal values, as a steady state or a condition "
            "before the beginning needs"
        )

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
        at = [float(margin(t, values)) for t in (0.0, 1.0, 2.0)]
        if not math.isclose(at[2] - at[1], at[1] - at[0], rel_tol=1e-9, abs_tol=1e-12):
            raise InputError(f"{self.where}: '{switch}' is not linear in time; only such conditions are taken")
        return -at[0] / (at[1] - at[0]) if at[1] != at[0] else math.inf

    def _samples(self, grid: np.ndarray, rows: Sequence[Row]) -> dict[str, np.ndarray]:
        """Channels of what differs between measurements: the entry of the next measurement, or of the last."""
        channels: dict[str, np.ndarray] = {}
        for name, parts in self.sampled.items():
            head, _, observable = name.partition("_")
            kind, index = head.split("Parameter")
            read = _of_observable(rows, observable) or _of_observable(self.tables.measurements, observable)
            own = sorted((_value(row, "time", self.where), _entries(row, kind)[int(index) - 1]) for row in read)
            which = np.minimum(np.searchsorted([t for t, _ in own], grid), len(own) - 1)
            entries = [own[k][1] for k in which]
            channels[name] = np.array([_number(e) or 0.0 for e in entries])
            channels |= {f"{name} is {p}": np.array([float(e == p) for e in entries]) for p in parts}
        return channels

    # ---- the problem

    def problem(self) -> Problem:
        """All of it."""
        records = self._records()
        sbml = self.tables.sbml
        inputs = [*self._sample_channels(), *self.switches, *(c for names in self.changing.values() for c in names)]
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
        fixed = {
            f"{n}[{record}]": value
            for record, (before, after) in self.conditions_of.items()
            for n, value in (self._fixed(before or after) | self._jumps(before, after)).items()
        }
        log = [n for n in self.free if self.table[n].get("parameterScale", "lin") in ("log", "log10")]
        return Problem(
            _sized(model, records, fixed),
            records,
            free=self.free,
            fixed=fixed,
            log=log,
            start={n: self.nominal[n] for n in self.free},
            noise={name: self._noise(name) for name in self.observables},
            constraints=list(self._bounds()),
            prior=bool(model.prior_std),
        )

    def _bounds(self) -> Iterable[Any]:
        for name in self.free:
            row = self.table[name]
            sides = [
                _value(row, side, self.where) if row.get(side) else math.inf for side in ("lowerBound", "upperBound")
            ]
            low, high = (side if math.isfinite(side) else None for side in sides)
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
            parts = [_number(part.strip()) for part in row.get("objectivePriorParameters", "").split(";")]
            if len(parts) != 2 or None in parts:
                raise InputError(f"{self.where}: objectivePriorParameters of '{name}' must be two numbers, like 0;1")
            mean, std = (float(part or 0.0) for part in parts)
            if kind not in ("normal", "parameterScaleNormal"):
                raise EstimationError(f"{self.where}: the prior of '{name}' is {kind}; only normal ones are taken")
            base = {"log10": math.log(10.0), "log": 1.0}.get(row.get("parameterScale", "lin"), 0.0)
            if kind == "normal" and base:
                raise EstimationError(f"{self.where}: '{name}' has a normal prior and is estimated by its logarithm")
            value = math.exp(mean * base) if base else mean
            self.values[name] = value
            found[name] = std * base * value if base else std
        return found


def _weighed(known: Mapping[str, Any], value: str, weights: Sequence[str], names: Sequence[str]) -> ca.SX:
    """A value and, each times its weight, what the names stand for."""
    return known[value] + sum((known[w] * known[n] for w, n in zip(weights, names, strict=True)), ca.SX(0))


def _of_observable(rows: Sequence[Row], observable: str) -> list[Row]:
    return [row for row in rows if row["observableId"] == observable]


def _without_nan(row: Row) -> Row:
    """A condition in which "not a number" is nothing, as the format means it."""
    return {n: "" if entry.lower() == "nan" else entry for n, entry in row.items()}


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
