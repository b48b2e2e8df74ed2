"""Results of a diagnosis as data: the contents of diagnosis.json, and the evidence behind them for the report."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from casid.data_check.reading import Finding
from casid.diagnosis.cause import Cause, Trace
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.size import missing_share
from casid.diagnosis.engine.trial import Round
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.noise import View
from casid.diagnosis.given.budget import AccountStep, Budget
from casid.diagnosis.given.contradicted import Contradiction, Factor, FlightValue
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.given.shape import Shape, shapes_of
from casid.diagnosis.kinematics.kinematics import Turbulence
from casid.diagnosis.systems.extended import Extended
from casid.errors import InputError
from casid.keeping import save, whole_file
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.model.system import Model
from casid.records.record import Record
from casid.views import view

if TYPE_CHECKING:
    from pandas import DataFrame

SCHEMA = "casid.diagnosis/3"
_INSTRUMENT_FAULTS = ("delay", "lag", "bias", "scale")


@dataclass(frozen=True, eq=False, kw_only=True)
class OfAircraft:
    """What the diagnosis of an aircraft has beside that of any system.

    file      the aircraft as given
    extended  the aircraft with estimated values and the named causes
    """

    file: Aircraft
    extended: Aircraft
    source: ClassVar[str] = "file"
    witness: ClassVar[str] = "flight"

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def values(self) -> dict[str, float]:
        """The values of the file, by name."""
        terms = {f"{c}_{term}": value for c, row in self.file.terms.items() for term, value in row.items()}
        free = [table for table in self.file.tables if table.free]
        knots = {name: value for table in free for name, value in table.knots.items()}
        found = {**self.file.derivatives, **terms, **knots}
        for value in self.file.effects:
            name = effect_of(value).name
            found |= {name: value.value} | {f"{name}.{key}": further for key, further in value.parameters.items()}
        return found

    @property
    def told(self) -> dict[str, float]:
        """The values whose changes the account names: derivatives, without those at zero angles and rates."""
        return {name: value for name, value in self.file.derivatives.items() if not name.endswith("_0")}


@dataclass(frozen=True, eq=False, kw_only=True)
class OfSystem:
    """What the diagnosis of a system has beside that of an aircraft.

    model     the system as given
    extended  with the named causes and fitted values: `extended.model`, which `extended.prepared(record)` feeds
    """

    model: Model
    extended: Extended
    source: ClassVar[str] = "model"
    witness: ClassVar[str] = "the records"

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def values(self) -> dict[str, float]:
        """The nominal values of the parameters."""
        return dict(self.model.nominal)

    @property
    def told(self) -> dict[str, float]:
        """The values whose changes the account names."""
        return self.values


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis:
    """The verdict and the evidence behind it, of an aircraft or of any system.

    Attributes
    ----------
    part
        What only an aircraft has, or only a system; see `aircraft`, `extended_aircraft` and `system`.
    not_judged
        What these records or this file leave open, and why.
    data
        Faults of the data.
    remark
        What is added to a verdict that names nothing.
    contradicted
        Numbers of the file or model that are inconsistent with the records, worst first.
    factors
        Common factors of groups of derivatives; these derivatives are not listed in `contradicted`.
    account
        Shares of the error on the held-out records that data, values and structure remove, the largest first.
    as_given, refitted, extended
        Simulations of the fitted records: as given, the re-estimated model and the extended model.
        `held_out_*` are the same on the held-out records.
    budget
        The error on the held-out records after each of these steps.
    flight
        Value of each number of the file or model by the records alone, estimated with the extended model.
    bare
        The baseline: the re-estimated model with expected structure, and with turbulence if the kinematics require it.
    missing_before, missing_after
        Latent inputs beside `bare` and beside the extended model, without model discrepancy. The verdict is made with
        it.
    unexplained
        Latent inputs that remain significant and large enough to matter, with model discrepancy.
    kinematic
        Instrument and air causes, ranked by the kinematics alone; empty if the records do not allow that.
    detectable
        Cause name -> smallest detectable size; infinite for a cause that derivatives reproduce at any size.
    seconds
        Wall time per stage.
    explanations
        The most probable combinations of causes, with probabilities.
    believed, entered
        Cause -> probability that it is present and matters; port -> probability that something unexplained enters
        there.
    nothing
        Probability that nothing that matters is wrong.
    trace
        The decisions on every cause that was considered, see `why` and `why_not`.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> found.verdict, [cause.sentence for cause in found.causes]  # doctest: +SKIP
    >>> found.extended_aircraft.write("extended.toml")  # doctest: +SKIP
    """

    verdict: str = ""
    headline: str = ""
    sentence: str = ""
    remark: str = ""
    not_judged: tuple[NotJudged, ...] = ()
    data: tuple[Finding, ...] = ()
    contradicted: tuple[Contradiction, ...] = ()
    factors: tuple[Factor, ...] = ()
    account: tuple[AccountStep, ...] = ()
    part: OfAircraft | OfSystem
    causes: tuple[Cause, ...]
    minor: tuple[Cause, ...]
    ranking: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    as_given: View
    refitted: View
    extended: View
    held_out_as_given: View
    held_out_refitted: View
    held_out_extended: View
    budget: Budget
    flight: Mapping[str, FlightValue]
    bare: FlightFit
    missing_before: tuple[MissingInput, ...]
    missing_after: tuple[MissingInput, ...]
    unexplained: tuple[MissingInput, ...]
    kinematic: tuple[Candidate, ...]
    turbulence: Turbulence
    detectable: Mapping[str, float]
    seconds: Mapping[str, float]
    explanations: tuple[tuple[tuple[str, ...], float], ...] = ()
    believed: Mapping[str, float] = field(default_factory=dict)
    entered: Mapping[str, float] = field(default_factory=dict)
    nothing: float | None = None
    trace: Trace = Trace()

    def why(self, cause: str) -> Trace:
        """The decisions on a cause: every gate with its value, its threshold and the name of the criterion.

        Parameters
        ----------
        cause
            As "actuator_lag(delta_e)" or "actuator_lag delta_e"; a kind alone stands for all its targets.

        Returns
        -------
        Trace
            Print it for the words.

        Raises
        ------
        InputError
            For a cause that was not considered, with the nearest one that was.
        """
        return self.trace.of(cause)

    def why_not(self, cause: str) -> Trace:
        """The decisions that kept a cause from being named, see `why`.

        Parameters
        ----------
        cause
            Kind and target, like ``actuator_lag(delta_e)``.

        Returns
        -------
        Trace
            The gates that the cause did not pass.

        Raises
        ------
        InputError
            For a cause that was not considered, and for one that was named.
        """
        return self.trace.against(cause)

    @property
    def of_aircraft(self) -> bool:
        """Whether an aircraft was diagnosed, and not another system."""
        return isinstance(self.part, OfAircraft)

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft as given."""
        return self._aircraft_part().file

    @property
    def extended_aircraft(self) -> Aircraft:
        """The aircraft with estimated values and the named causes."""
        return self._aircraft_part().extended

    def _aircraft_part(self) -> OfAircraft:
        if isinstance(self.part, OfAircraft):
            return self.part
        raise InputError(f"this diagnosis is of '{self.part.name}', which is no aircraft; see diagnosis.system")

    @property
    def system(self) -> OfSystem:
        """The system as given, and with the named causes."""
        if isinstance(self.part, OfSystem):
            return self.part
        raise InputError(f"this diagnosis is of the aircraft '{self.part.name}'; see diagnosis.extended_aircraft")

    @property
    def noise(self) -> dict[str, float]:
        """Output -> 1-sigma of the noise of its samples as recorded."""
        fit = self.extended.fit
        return {name: sigma * math.sqrt(fit.flight.every) for name, sigma in fit.noise.measurement.items()}

    @property
    def criteria(self) -> Criteria:
        """The thresholds that were used."""
        return self.bare.criteria

    @property
    def detectable_by_channel(self) -> dict[str, dict[str, float]]:
        """Channel -> "delay", "lag", "bias", "scale" -> the smallest that these records would have shown, in SI units;
        infinite where the derivatives absorb any size."""
        found: dict[str, dict[str, float]] = {}
        for effect in self.bare.flight.effects:
            kind = effect.kind.removeprefix("sensor_")
            if effect.name in self.detectable and effect.kind in (f"sensor_{k}" for k in _INSTRUMENT_FAULTS):
                size = self.detectable[effect.name]
                found.setdefault(effect.target, {})[kind] = size if size <= effect.limit else math.inf
        return found

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Curves of unexplained latent inputs at coefficients, if the held-out records support them; they are not
        causes.
        """
        return shapes_of(self.extended.fit, self.held_out_extended.fit, self.unexplained, self.criteria.given.worse)

    @property
    def is_extended(self) -> bool:
        """Whether the extended model has a cause, named or minor, that the re-estimated model lacks."""
        return self.extended.fit is not self.refitted.fit

    @property
    def best(self) -> str:
        """The name of the extended model; without any added cause it is the re-estimated file or model."""
        return "extended model" if self.is_extended else f"re-estimated {self.part.source}"

    @property
    def bic(self) -> float:
        """Change of the Bayesian information criterion by the extension; negative is better."""
        before, after = self.refitted.fit, self.extended.fit
        return after.deviance - before.deviance + (_freedom(after) - _freedom(before)) * math.log(self.refitted.samples)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter of the file or model, effects of the file included: its value there, and its estimates."""
        before, after, a_priori = self.refitted.fit, self.extended.fit, self.part.values
        names = [slot.name for slot in before.slots]
        units = {name: before.model.units.get(name, "") for name in before.derivatives}
        units |= {one.name: one.effect.unit for one in before.attached}
        there = {slot.name for slot in after.slots}
        return tuple(
            Parameter(
                name=name,
                unit=units.get(name, ""),
                a_priori=a_priori.get(name, 0.0),
                refitted=before[name],
                refitted_std=before.std(name),
                extended=after[name],
                extended_std=after.std(name),
                flight=self.flight[name],
            )
            for name in names
            if name in there
        )

    def __repr__(self) -> str:
        count = f"{len(self.causes)} causes, {len(self.minor)} minor"
        return f"<Diagnosis of '{self.part.name}': {self.verdict}; {count}; print it for the words>"

    def _repr_html_(self) -> str:
        return view("diagnosis.html")(self)

    def save(self, path: str | Path) -> None:
        """Write it whole into a file, for `casid.load`; see `casid.keeping` for what that is good for.

        Parameters
        ----------
        path
            Name of the file.

        Raises
        ------
        InputError
            For a system other than an aircraft: its causes are functions, which a file cannot hold.
        """
        if not self.of_aircraft:
            raise InputError(
                f"diagnosis.save: '{self.part.name}' is no aircraft, and its causes are functions that a file cannot "
                "hold; write(path) keeps the document"
            )
        save(self, path)

    def to_frame(self) -> DataFrame:
        """Causes as a pandas data frame, a row for each, minor ones last; needs the extra `pandas`.

        Returns
        -------
        DataFrame
            Data frame of pandas.
        """
        return view("diagnosis.frame")(self)

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict}", self.sentence]
        lines += [f"  - data, {one.handled}: {one.sentence}" for one in self.data]
        lines += [f"  - values: {one.sentence}" for one in (*self.factors, *self.contradicted)]
        lines += [
            f"  - {cause.sentence} ({_sure(cause)}likelihood-ratio statistic {cause.statistic:.0f})"
            for cause in self.causes
        ]
        lines += [f"  - minor: {cause.sentence}" for cause in self.minor]
        lines += [f"  - not judged: {one.what} ({one.because})" for one in self.not_judged]
        steps = self.budget.together
        lines.append(
            f"error on {', '.join(self.budget.records)}, times the noise: {steps.as_given:.2g} as given, "
            f"{steps.data_mended:.2g} with the data corrected, {steps.values:.2g} with values re-estimated, "
            f"{steps.structure:.2g} with the causes added"
        )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        return {
            "schema": SCHEMA,
            **({} if self.of_aircraft else {"system": self.part.name}),
            "verdict": self.verdict,
            "sentence": self.sentence,
            "not_judged": [one.to_dict() for one in self.not_judged],
            "data": [one.to_dict() for one in self.data],
            "notes": {record.name: list(record.notes) for record in self._records},
            "account": [one.to_dict() for one in self.account],
            "factors": [one.to_dict() for one in self.factors],
            "contradicted": [one.to_dict() for one in self.contradicted],
            "causes": [cause.to_dict() for cause in self.causes],
            "minor": [cause.to_dict() for cause in self.minor],
            "ranking": [rank_entry(candidate) for candidate in self.ranking],
            "decisions": [one.to_dict() for one in self.trace.decisions],
            "unexplained": [self._unexplained(one) for one in self.unexplained],
            "shapes": [one.to_dict() for one in self.shapes],
            "explanations": [{"causes": list(names), "probability": p} for names, p in self.explanations],
            "believed": dict(self.believed),
            "nothing": self.nothing,
            "budget": self.budget.to_dict(),
            "as_given": self.as_given.to_dict(),
            "refitted": self.refitted.to_dict(),
            "extended": self.extended.to_dict(),
            "gain": {"held_out": self._held_out(), "bic": self.bic},
            "parameters": {one.name: one.to_dict() for one in self.parameters},
            "missing": {
                "before": {m.station: m.gain for m in self.missing_before},
                "after": {m.station: m.gain for m in self.missing_after},
            },
            "smallest_detectable": {n: v if math.isfinite(v) else None for n, v in self.detectable.items()},
            "detectable": self.detectable_by_channel,
            "seconds": dict(self.seconds),
        }

    @property
    def _records(self) -> tuple[Record, ...]:
        """The fitted records, then the held-out ones."""
        return (*self.refitted.fit.flight.records, *self.held_out_as_given.fit.flight.records)

    def _unexplained(self, missing: MissingInput) -> dict[str, Any]:
        fit = next(v.fit for v in (self.extended, self.held_out_extended) if missing.concerns(v.records))
        place = missing.place
        return {
            "port": place.name if place.kind == "coefficient" or not self.of_aircraft else place.key,
            "kind": place.kind,
            "probability": self.entered.get(missing.station),
            "share": missing_share(fit, missing),
            "gain": missing.gain,
            "sentence": f"Something that no cause of the catalogue explains enters at {missing.words}.",
        }

    def _held_out(self) -> dict[str, Any]:
        before, after = self.held_out_as_given, self.held_out_extended
        return {
            "records": list(before.records),
            "rms_ratio": self.rms_ratio,
            "log_likelihood_per_sample": (after.log_likelihood - before.log_likelihood) / before.samples,
        }

    @property
    def rms_ratio(self) -> dict[str, float]:
        """Channel -> r.m.s. residual of the extended model over that of the file as given, on held-out records; worst
        first.
        """
        before, after = self.held_out_as_given.channels, self.held_out_extended.channels
        ratio = {o: after[o].rms / c.rms for o, c in before.items() if c.rms > 0 and o in after}
        return dict(sorted(ratio.items(), key=lambda item: -item[1]))

    def write(self, path: str | Path) -> None:
        """Write diagnosis.json. If that fails, no partial file is left.

        Parameters
        ----------
        path
            Name of the file.
        """
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(plain(self.to_dict()), indent=1, allow_nan=False), encoding="utf-8")


def _freedom(fit: FlightFit) -> int:
    """Number of estimated quantities, with onsets and the strength of turbulence."""
    return len(fit.slots) + sum(len(one.onsets) for one in fit.attached) + bool(fit.noise.coloured)


def _sure(cause: Cause) -> str:
    return "" if cause.probability is None else f"{100.0 * cause.probability:.0f} % probable, "


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of the file or model, in `unit`: for an aircraft a derivative, term or effect.

    Attributes
    ----------
    a_priori
        Its value as given; 0 if there is none.
    refitted, refitted_std
        Its estimate with the structure as given, and the standard deviation (Cramer-Rao).
    extended, extended_std
        The same in the extended model.
    flight
        Its value according to the records alone, with a corrected standard deviation.
    """

    name: str
    unit: str
    a_priori: float
    refitted: float
    refitted_std: float
    extended: float
    extended_std: float
    flight: FlightValue

    def to_dict(self) -> dict[str, Any]:
        return {
            "unit": self.unit,
            "a_priori": self.a_priori,
            "refitted": {"value": self.refitted, "std": self.refitted_std},
            "extended": {"value": self.extended, "std": self.extended_std},
            "flight": {"value": self.flight.value, "std": self.flight.std, "told": self.flight.determined},
        }


def plain(value: Any) -> Any:
    """The value as numbers and containers that JSON can hold; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    number = float(value)
    return number if math.isfinite(number) else None


def rank_entry(candidate: Candidate) -> dict[str, Any]:
    """An entry of `ranking`."""
    effect = candidate.attached.effect
    return {
        "kind": effect.kind,
        "target": effect.target,
        "term": effect.term,
        "statistic": candidate.statistic,
        "value": candidate.value,
        "std": candidate.std,
        "surviving": candidate.surviving,
    }
