"""Results of a diagnosis as data: the contents of diagnosis.json, and the evidence behind them for the report."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from casid.data_check.reading import Finding
from casid.design.next_flight import NextFlights, Setting, Untold, next_flights
from casid.diagnosis.axis_responses import axis_responses
from casid.diagnosis.cause import Cause, Trace
from casid.diagnosis.claims import Claim
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnosed import DiagnosedAircraft, DiagnosedSystem
from casid.diagnosis.document import Called, Document, Explanation, Unexplained
from casid.diagnosis.engine.trial import Round
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.evidence.size import missing_share
from casid.diagnosis.facts import ChangedValue, Combination, Parameter
from casid.diagnosis.first_screen import next_steps, text
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.flight import resting
from casid.diagnosis.flight.noise import Following, View, following
from casid.diagnosis.given.budget import AccountStep, Budget
from casid.diagnosis.given.contradicted import Contradiction, FlightValue
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.given.shape import Shape, shapes_of
from casid.diagnosis.kinematics.turbulence import Turbulence
from casid.diagnosis.left_open import questions, untold
from casid.diagnosis.shown import (
    alike_of,
    detectable_of,
    drawn_cause,
    gusts_of,
    histories_of,
    ranked_of,
    reported,
    simulated_of,
    titled,
    tried_of,
)
from casid.errors import InputError, noting, unknown
from casid.frames import Rows, html_list, html_paragraph
from casid.keeping import plain, save, whole_file
from casid.model.aircraft import Aircraft

if TYPE_CHECKING:
    from pandas import DataFrame

_INSTRUMENT_FAULTS = ("delay", "lag", "bias", "scale")
_FITTED = ("as_given", "refitted", "extended")
_IN_BOTH = (
    *("verdict", "headline", "sentence", "opening", "values_told", "best", "no_cause", "not_judged", "data"),
    *("contradicted", "parameters", "flight", "trace", "budget", "rms_ratio", "criteria", "seconds", "account"),
    *("factors", "moved", "combinations", "claims", "believed", "nothing", "bic", "seconds_of_processor"),
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis:
    """The verdict and the evidence behind it, of an aircraft or of any system.

    Attributes
    ----------
    diagnosed
        What only an aircraft has, or only a system; see `aircraft`, `extended_aircraft` and `system`.
    not_judged, not_tried
        What these records or this file leave open, and why; with what the search did not try, which is also alone.
    data
        Faults of the data.
    remark
        What is added to a verdict that names nothing.
    contradicted
        Numbers of the file or model that are inconsistent with the records, worst first.
    factors
        Common factors of groups of derivatives; these derivatives are not listed in `contradicted`.
    moved, combinations
        Values of the extended model that left their stated uncertainty; and combinations of two that the records
        determine where they determine neither.
    claims
        Statements that the verdict rests on, each with the reason if it is not made.
    held_out_is_new
        Empty if the held-out records are flights of their own; otherwise why not.
    opening, values_told
        Sentences of the simulation as given with what accounts for its error, and of the values.
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
    seconds, seconds_of_processor
        Wall time per stage, and time of the processor in all.
    explanations
        The most probable combinations of causes, with probabilities.
    believed, entered
        Cause -> probability that it is present and matters; port -> probability that something unexplained enters
        there.
    nothing
        Probability that nothing that matters is wrong.
    trace
        The decisions on every cause that was considered, see `why` and `why_not`.
    called
        How it was asked for, so that the commands of what to do next can be copied.

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
    opening: str = ""
    values_told: str = ""
    remark: str = ""
    not_judged: tuple[NotJudged, ...] = ()
    not_tried: tuple[NotJudged, ...] = ()
    data: tuple[Finding, ...] = ()
    contradicted: tuple[Contradiction, ...] = ()
    factors: tuple[Factor, ...] = ()
    moved: tuple[ChangedValue, ...] = ()
    combinations: tuple[Combination, ...] = ()
    claims: tuple[Claim, ...] = ()
    held_out_is_new: str = ""
    seconds_of_processor: float = 0.0
    account: tuple[AccountStep, ...] = ()
    diagnosed: DiagnosedAircraft | DiagnosedSystem
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
    called: Called = Called()

    def claim(self, statement: str) -> Claim:
        """The claim with a statement of `claims`.

        Raises
        ------
        InputError
            For a statement that is none of the claims.
        """
        by = {one.statement: one for one in self.claims}
        if statement not in by:
            raise unknown("statement", statement, by, "diagnosis.claim")
        return by[statement]

    def why(self, cause: str) -> Trace:
        """The decisions on a cause: every gate with its value, its threshold and the name of the criterion.

        Parameters
        ----------
        cause
            As "actuator_lag(delta_e)" or "actuator_lag delta_e"; a kind alone selects all its targets.

        Raises
        ------
        InputError
            For a cause that was not considered, with the nearest one that was.
        """
        return self.trace.of(cause)

    def why_not(self, cause: str) -> Trace:
        """The decisions that kept a cause like ``actuator_lag(delta_e)`` from being named, see `why`.

        Raises
        ------
        InputError
            For a cause that was not considered, and for one that was named.
        """
        return self.trace.against(cause)

    @property
    def is_aircraft(self) -> bool:
        """Return True if an aircraft was diagnosed, and not another system."""
        return isinstance(self.diagnosed, DiagnosedAircraft)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Coefficients of the aerodynamics that were diagnosed; empty for other systems and beside rotors."""
        return self.extended.fit.flight.coefficients

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft as given."""
        return self._diagnosed_aircraft().file

    @property
    def extended_aircraft(self) -> Aircraft:
        """The aircraft with estimated values and the named causes."""
        return self._diagnosed_aircraft().extended

    def _diagnosed_aircraft(self) -> DiagnosedAircraft:
        if isinstance(self.diagnosed, DiagnosedAircraft):
            return self.diagnosed
        raise InputError(f"this diagnosis is of '{self.diagnosed.name}', which is no aircraft; see diagnosis.system")

    @property
    def system(self) -> DiagnosedSystem:
        """The system as given, and with the named causes."""
        if isinstance(self.diagnosed, DiagnosedSystem):
            return self.diagnosed
        raise InputError(f"this diagnosis is of the aircraft '{self.diagnosed.name}'; see diagnosis.extended_aircraft")

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
                found.setdefault(effect.target, {})[kind] = size if size <= effect.size.limit else math.inf
        return found

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Curves of unexplained latent inputs at coefficients, if the held-out records support them; they are not
        causes.
        """
        return shapes_of(self.extended.fit, self.held_out_extended.fit, self.unexplained)

    @property
    def untold(self) -> tuple[Untold, ...]:
        """Numbers of an aircraft file that the records do not determine."""
        return tuple(untold(self.parameters, self.aircraft, self.extended.fit.flight))

    def next_flights(self) -> NextFlights:
        """Design the manoeuvres that would answer what these records leave open; about 5 s of processor time each."""
        if not self.coefficients:
            return NextFlights()
        setting = Setting(
            aircraft=self.extended_aircraft,
            records=self.refitted.fit.flight.records,
            resting=resting(self.extended.fit.flight.records),
            noise=self.noise,
        )
        unmoved = [one for one in self.untold if one.unmoved(self.criteria.parts.half)]
        return next_flights(questions(self.causes, self.unexplained, self.rounds), unmoved, setting)

    def document(self, figures: bool = True) -> Document:
        """Return the content of the diagnosis in words, numbers and arrays. What cannot be computed is noted in it.

        Parameters
        ----------
        figures
            Whether it has the curves of figures and the design of next flights, which take some seconds.
        """
        failed = list[str]()
        most = self.criteria.numerics.naming.trials
        aircraft = self.aircraft if self.is_aircraft else None
        known = {one.name: one for one in self.bare.flight.effects}
        before = {one.station: one for one in self.missing_before}
        views = (self.as_given, self.extended)
        causes = []
        gusts = None
        shapes = tuple[Shape, ...]()
        next_ones = NextFlights()
        responses = None
        for number, cause in enumerate(self.causes):
            drawn = reported(cause)
            with noting(failed, cause.name):
                if figures and self.coefficients and number < most:
                    drawn = drawn_cause(cause, self.bare, views, before)
            causes.append(drawn)
        with noting(failed, "shapes"):
            shapes = self.shapes
        if figures:
            with noting(failed, "moving air"):
                gusts = gusts_of(self.extended.fit, self.turbulence.sigma)
            with noting(failed, "response of each axis"):
                if aircraft is not None and aircraft.rotors:
                    responses = axis_responses(aircraft, self.extended_aircraft, self.as_given.fit.flight.records)
            with noting(failed, "next flight"):
                next_ones = self.next_flights()
        least = self.criteria.parts.half
        untold = self.untold if self.coefficients else ()
        document = Document(
            **{name: getattr(self, name) for name in _IN_BOTH} | self._simulated(figures),
            name=self.diagnosed.name,
            source=self.diagnosed.source,
            witness=self.diagnosed.witness,
            aircraft=aircraft,
            coefficients=self.coefficients,
            held_out_is_new=self.held_out_is_new or True,
            left=self.claim("nothing that matters is left").because,
            causes=tuple(causes),
            minor=tuple(reported(one) for one in self.minor),
            ranking=tuple(ranked_of(self.ranking)),
            explanations=tuple(
                Explanation(causes=names, titles=tuple(titled(name, known) for name in names), probability=p)
                for names, p in self.explanations
            ),
            tried=tuple(tried_of(self.rounds)),
            alike=alike_of(self.rounds),
            missing_before={one.station: one.gain for one in self.missing_before},
            missing_after={one.station: one.gain for one in self.missing_after},
            unexplained=tuple(self._shown(one) for one in self.unexplained),
            shapes=shapes,
            suspects=tuple(ranked_of(self.kinematic)),
            turbulent=self.turbulence.records if self.turbulence.named else (),
            gusts=gusts,
            axis_responses=responses,
            unseen=tuple(detectable_of(known.values(), self.detectable)),
            smallest_detectable=self.detectable,
            detectable=self.detectable_by_channel,
            next_flights=next_ones,
            limited=tuple(one for one in untold if not one.unmoved(least)),
            failed=tuple(failed),
        )
        unmoved = [one for one in untold if one.unmoved(least)]
        asked = list(questions(self.causes, self.unexplained, self.rounds))
        return replace(document, next=next_steps(document, self.causes, asked, unmoved, self.called))

    def _simulated(self, figures: bool) -> dict[str, Any]:
        """The simulations by their names; two of one view are one."""
        views = {name: getattr(self, name) for name in (*_FITTED, *(f"held_out_{name}" for name in _FITTED))}
        made = {id(view): simulated_of(view, figures) for view in views.values()}
        return {name: made[id(view)] for name, view in views.items()}

    def _shown(self, missing: MissingInput) -> Unexplained:
        """A latent input that no cause explains, with its time histories."""
        fit = self.refitted.fit
        place = missing.place
        fitted = missing.concerns(fit.batch.names)
        by = self.extended.fit if fitted else self.held_out_extended.fit
        return Unexplained(
            station=missing.station,
            called=missing.called,
            port=place.name if place.kind == "coefficient" or not self.is_aircraft else place.key,
            kind=place.kind,
            fitted=fitted,
            probability=self.entered.get(missing.station),
            share=missing_share(by, missing),
            gain=missing.gain,
            sentence=f"Something that {self.no_cause} enters at {missing.words}.",
            histories=tuple(histories_of(fit if fitted else self.held_out_extended.fit, missing)),
        )

    @property
    def is_extended(self) -> bool:
        """Return True if the extended model has a cause, named or minor, that the re-estimated model lacks."""
        return self.extended.fit is not self.refitted.fit

    @property
    def no_cause(self) -> str:
        """The words for what is left: that no cause explains it, of those that were tried."""
        if self.not_tried:
            return "none of the causes that were tried explains" if self.rounds else "no cause was tried for"
        return "no cause of the catalogue explains"

    @property
    def best(self) -> str:
        """The name of the extended model; without any added cause it is the re-estimated file or model."""
        return "extended model" if self.is_extended else f"re-estimated {self.diagnosed.source}"

    @cached_property
    def following(self) -> Following | None:
        """Output whose innovations follow earlier changes of the inputs most, in moving air; None in calm air."""
        return following(self.extended.fit) if self.extended.fit.noise.coloured else None

    @property
    def bic(self) -> float:
        """Change of the Bayesian information criterion by the extension; negative is better."""
        before = self.refitted.fit
        after = self.extended.fit
        return after.deviance - before.deviance + (_freedom(after) - _freedom(before)) * math.log(self.refitted.samples)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter of the file or model, effects of the file included: its value there, and its estimates."""
        before = self.refitted.fit
        after = self.extended.fit
        a_priori = self.diagnosed.values
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
                extended=after[name],
                cramer_rao=(before.std(name), after.std(name)),
                flight=self.flight[name],
            )
            for name in names
            if name in there
        )

    def __repr__(self) -> str:
        count = f"{len(self.causes)} causes, {len(self.minor)} minor"
        return f"<Diagnosis of '{self.diagnosed.name}': {self.verdict}; {count}; print it for the words>"

    def _repr_html_(self) -> str:
        return (
            html_paragraph(f"{self.diagnosed.name}: {self.verdict}", self.sentence)
            + html_list(one.sentence for one in (*self.data, *self.contradicted))
            + self.rows().html()
        )

    def save(self, path: str | Path) -> None:
        """Write it whole into a file, for `casid.load`; see `casid.keeping` for what that is good for.

        Raises
        ------
        InputError
            For a system other than an aircraft: its causes are functions, which a file cannot hold.
        """
        if not self.is_aircraft:
            raise InputError(
                f"diagnosis.save: '{self.diagnosed.name}' is no aircraft, and its causes are functions that a file "
                "cannot hold; write(path) keeps the document"
            )
        save(self, path)

    def to_frame(self) -> DataFrame:
        """Causes as a pandas data frame, a row for each, minor ones last; needs the extra `pandas`."""
        return self.rows().frame()

    def rows(self) -> Rows:
        """Causes as rows, minor ones last."""
        heads = {"kind": "", "target": "", "term": "", "value": ".4g", "std": ".2g", "unit": "", "held_out_gain": ".3g"}
        heads = {"cause": "", **heads, "sentence": ""}
        rows = [
            (one.name, *(getattr(one, name) for name in list(heads)[1:]), ", ".join(one.records), one in self.minor)
            for one in (*self.causes, *self.minor)
        ]
        return Rows(heads={**heads, "records": "", "minor": ""}, rows=rows)

    def __str__(self) -> str:
        return text(self.document(figures=False))

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json: the document without its curves."""
        return self.document(figures=False).to_dict()

    @property
    def rms_ratio(self) -> dict[str, float]:
        """Channel -> r.m.s. residual of the extended model over that of the file as given, on held-out records; worst
        first.
        """
        before = self.held_out_as_given.channels
        after = self.held_out_extended.channels
        ratio = {o: after[o].rms / c.rms for o, c in before.items() if c.rms > 0 and o in after}
        return dict(sorted(ratio.items(), key=lambda item: -item[1]))

    def write(self, path: str | Path) -> None:
        """Write diagnosis.json. If that fails, no partial file is left."""
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(plain(self.to_dict()), indent=1, allow_nan=False), encoding="utf-8")


def _freedom(fit: FlightFit) -> int:
    """Number of estimated quantities, with onsets and the strength of turbulence."""
    return len(fit.slots) + sum(len(one.onsets) for one in fit.attached) + bool(fit.noise.coloured)
