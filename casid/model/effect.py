"""Define an effect and a kind of cause, and keep the register of causes.

A cause is one `@cause` function that returns an `Effect`: an extra piece at one station of the signal path. It enters
in one of three ways, and simulation, estimation, screening, extension of the aircraft file and the generator of hidden
effects all use the same definition:

change   symbolic: it changes the path at `station`, or the draft of a system that is no aircraft. Its value is a
         parameter of the model, 0 = absent
series   a time history at a disturbance station of the path, computed from the record (a lagged surface, a gust)
output   an operator on what an instrument reads (delay, lag)

An effect with a state of its own gives both `change` and `series`: a model that has it takes the first. A diagnosis,
which weighs it against others before it is in the model, the second.
All else that is known of a cause is in its definition too; nothing outside compares names of kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from itertools import product, starmap
from typing import Any, Protocol

import numpy as np

from casid.errors import InputError
from casid.model.airframe import Airframe
from casid.model.operators import folded
from casid.model.rotors import ALL, Rotors
from casid.model.tables import Table
from casid.model.terms import COEFFICIENTS, parse_term
from casid.signals import SURFACES, unit_of

Values = Mapping[str, float]
Symbols = Mapping[str, Any]  # the same as CasADi expressions
Series = Mapping[str, np.ndarray]


class Readable(Protocol):
    """Interface of what faults of instruments change: the signal path of an aircraft, the draft of any model."""

    def reads(self, channel: str, read: Callable[[Any], Any], true: Callable[[Any], Any]) -> None:
        """Let an instrument `read` something else than what is; of an input, `true` gives what acts from its record."""


class Equations(Readable, Protocol):
    """Interface of what effects in the equations of any model change."""

    def adds(self, state: str, expression: Any) -> None:
        """Add an expression to the equation of a state."""

    def shifts(self, parameter: str, by: Any, equation: str = "") -> None:
        """Let a parameter differ from its value by an expression, in the `equation` of a state or in all."""

    def scales(self, name: str, by: Any) -> None:
        """Multiply the equation of a state, or a parameter."""

    def term(self, name: str) -> Any:
        """Expression of a term in states and inputs."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """Smallest size of an effect that matters, and the largest that is possible."""

    # the smallest size that matters to an engineer, in `unit`, or a function of the aircraft that gives it; None:
    # judged by its part of a coefficient, or of a channel
    meaningful: float | Callable[[Airframe], float] | None = None
    # typical deflection of what drives an oscillation of the channel `target`: the value times this is judged by its
    # part of the variation of that channel
    amplitude: float | None = None
    # it is judged against the stated uncertainty of a number of the file, and not against noise
    stated: bool = False
    limit: float = np.inf  # the largest plausible value, in `unit`
    limits: Mapping[str, float] = field(default_factory=dict)  # the same of further parameters
    lowest: float | None = None  # the lowest value, where it is not -limit
    # what of the aircraft bounds it beside `limit`: "span", "chord", "arm" of the rotors, "mass" or "inertia"
    within: str | None = None


@dataclass(frozen=True, kw_only=True)
class Event:
    """When an effect acts."""

    timed: bool = True  # it begins at an onset [s] of its own in every record concerned
    recurring: bool = False  # other records may repeat it
    # the duration from its onset to its end: records determine its middle
    extent: str | None = None
    # how long it acts: its onset and its end are apart, and nothing is left after it
    lasts: str | None = None


def grid(**sizes: Iterable[float]) -> tuple[dict[str, float], ...]:
    """Every combination of sizes by name, the last one first."""
    return tuple(dict(zip(sizes, chosen, strict=True)) for chosen in product(*sizes.values()))


@dataclass(frozen=True, kw_only=True)
class Further:
    """Values to try and limits of the parameters of an effect, before they are fitted."""

    # values of the further parameters (and of "value" when not linear) that a screening tries
    grid: tuple[Mapping[str, float], ...] = ({},)
    # further parameters that an aircraft file may leave out
    defaults: Mapping[str, float] = field(default_factory=dict)
    unsigned: tuple[str, ...] = ()  # values of which only the size counts
    # values between -1 and 1 that a fit may leave: they run back there (`operators.folded`)
    folded: tuple[str, ...] = ()
    # mean and 1-sigma of further parameters that records may not determine
    usual: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    either_sign: bool = False  # a gain early and a loss late resemble each other: both signs are tried

    @property
    def typical(self) -> Mapping[str, float]:
        """The first values that a screening tries; none where it tries none."""
        return self.grid[0] if self.grid else {}


@dataclass(frozen=True, kw_only=True)
class Traits:
    """Conditions under which a diagnosis accepts an effect, and what imitates it."""

    grounded: bool = False  # accepted only when kinematics see it: what a file lacks of the forces reads the same
    # it may be in some records and not in others: instruments and loading change between flights
    by_record: bool = False
    # free derivatives imitate it when it is in all records: only differences between records show
    relative: bool = False
    # kinds of simpler effects that are special cases of it: where one of these does as well, it comes first
    includes: tuple[str, ...] = ()
    # kinds, targets and terms of effects as which it shows in all records, because free derivatives take up the rest or
    # nearly all of it is the same; one at its own target has the other sign
    shows_as: tuple[tuple[str, str, str | None], ...] = ()
    # aircraft, None of another system -> the effect that is equal by algebra, and the value of that for one of this
    equal: Callable[[Any], tuple[Effect, float]] | None = None
    covered_by: str | None = None  # a channel whose own effect of this kind includes this one, when it is measured
    expected: bool = False  # structure that other aircraft have: put into the model when it is found, and no fault
    # contrary to the symmetry of an aircraft: accepted only when nothing is missing anywhere beside it
    improbable: bool = False
    constant: bool = False  # an offset, which a drift imitates: accepted only when its reading is steady beside it
    late: bool = False  # the value is by how much [s] the reading is late
    # it changes what steady flight takes of the rotors: the likely reason where this has left its limits
    balance: bool = False
    last_resort: bool = False  # proposed only where something is still missing when all other causes were tried


@dataclass(frozen=True, kw_only=True)
class Forms:
    """Other forms of the same effect, which some of its users need."""

    # inverse of `output`: from what was read to what a perfect instrument gives; None: what `output` adds does not
    # depend on the reading it is added to, and is subtracted
    undo: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None
    # (true output, reading, values) -> rate of the reading: an `output` effect as a state of the model
    instrument: Callable[[Any, Any, Symbols], Any] | None = None
    # (t, values) -> (N,) by how much [s] readings of the target are late: they are of the motion at an earlier time
    late: Callable[[np.ndarray, Values], Any] | None = None
    # (readings, values) -> what is written down of them: only a simulation does, an estimator has it as noise
    written: Callable[[np.ndarray, Values], np.ndarray] | None = None
    # (s, values) -> transfer function of a linear one: of the surface that acts over its record by `series`, or of what
    # is read over what is true by `output`; s is complex, (frequencies,) [1/s]
    transfer: Callable[[np.ndarray, Values], np.ndarray] | None = None
    # (1-sigma, sampling interval, values) -> (1-sigma, correlation time) of what white noise in the recorded input
    # `target` is behind `series`, which then takes the record as it is; None: white still
    noise: Callable[[float, float, Values], tuple[float, float]] | None = None
    # (tables of an aircraft, value) -> the tables with it in them, or None where none can hold it: an extended file
    # then has it there, and not as an effect
    into_tables: Callable[[tuple[Table, ...], float], tuple[Table, ...] | None] | None = None
    # (rotors of an aircraft, its weight [N], value) -> the rotors with it in their numbers, for files of other
    # simulators; None where these cannot hold it
    into_rotors: Callable[[Rotors, float, float], Rotors | None] | None = None


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One cause at one target."""

    kind: str = ""  # that of its `cause` where it is not given
    target: str = ""
    term: str | None = None
    variant: str = ""  # separates it from an effect of its kind and target with other further parameters
    # the value is an amplitude that enters linearly at its null 0, so a score gives its size; otherwise (lag, dead
    # zone) sizes of `further.grid` are tried
    linear: bool = True
    further: Further = Further()
    size: Size = Size()
    event: Event = Event(timed=False)
    traits: Traits = Traits()
    forms: Forms = Forms()
    reads: tuple[str, ...] = ()  # it shows in these channels alone: one of them must be measured
    kinematic: bool = False  # an instrument or the air is at fault: kinematics without aerodynamics can judge it
    regressor: str | None = None  # term that the value multiplies in the coefficient `target`
    # coefficients that change together, the first by the value, the others by parameters of their names
    members: tuple[str, ...] = ()
    enters: str | None = None  # disturbance station at which an unknown time history would replace it
    station: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)  # SI units of the further parameters that `change` takes
    # further state -> channel that it starts from; `change` sets its rate in `path.derivative`
    states: Mapping[str, str] = field(default_factory=dict)
    change: Callable[[Any, Symbols], None] | None = None
    series: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None
    output: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None
    # unit of the value of an effect at a port of a model that is no aircraft; empty if it is not stated
    unit_at_port: str | None = None

    @property
    def name(self) -> str:
        """Name of its parameter in a model and in tables, e.g. "actuator_lag(delta_e)"."""
        inside = self.target + (f":{self.term}" if self.term else "") + (f", {self.variant}" if self.variant else "")
        return f"{self.kind}({inside})" if inside else self.kind

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        own = self.unit_at_port
        return KINDS[self.kind].unit_for(self.target, self.term) if own is None else own

    @property
    def key(self) -> tuple[str, str, str | None]:
        return self.kind, self.target, self.term

    @property
    def stochastic(self) -> bool:
        """Return True if it is noise alone: of the motion, or of what is written down."""
        return self.change is None and self.series is None and self.output is None

    @property
    def symbolic(self) -> bool:
        """Return True if a diagnosis has it as a parameter of its model."""
        return self.change is not None and self.series is None

    @property
    def in_equations(self) -> bool:
        """Return True if the equation-error form of a model has it: it enters there, and has no state."""
        return self.change is not None and self.station in ("coefficients", "mass") and not self.states

    @property
    def timed(self) -> bool:
        """Return True if it begins at an onset."""
        return self.event.timed

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of its parameters beside the value."""
        return tuple(name for name in self.further.typical if name != "value")

    @property
    def quasi_steady(self) -> bool:
        """Return True if it is a term of the present regressors, and of no rate of them."""
        return self.regressor is not None and "dot" not in self.regressor

    @property
    def of_an_instrument(self) -> bool:
        """Return True if an instrument is at fault throughout a record: no error of the aerodynamics looks like it."""
        return self.kinematic and not self.timed and not self.stochastic

    @property
    def of_a_surface(self) -> bool:
        """Return True if it lies between a record and its control surface throughout a record: a lag or a play."""
        return self.series is not None and self.target in SURFACES and not self.timed

    @property
    def of_hardware(self) -> bool:
        """Return True if it lies in an instrument, or between a record and what acts by it, throughout a record."""
        at_a_port = KINDS[self.kind].place in ("command", "reading") and not self.timed
        return self.of_an_instrument or self.of_a_surface or at_a_port

    def __reduce__(self) -> tuple[Callable[..., Effect], tuple[Any, ...]]:
        """Pickle by the name in the register of causes, since functions cannot be pickled, and all other fields."""
        if _registered(*self.key, self.name) is None:
            raise InputError(f"{self.name}: not in the register of causes, so that it cannot be pickled; use @cause")
        return _again, (*self.key, self.name, _no_functions(self))

    def in_words(self, values: Values) -> dict[str, float]:
        """Fitted values as they are reported and written into a file."""
        by = self.further
        told = {name: abs(float(v)) if name in by.unsigned else float(v) for name, v in values.items()}
        return told | {name: float(np.real(folded(told[name]))) for name in by.folded if name in told}

    def smallest_that_matters(self, aircraft: Airframe) -> float | None:
        """`size.meaningful` for this aircraft."""
        least = self.size.meaningful
        return least(aircraft) if callable(least) else least


def with_grid(effect: Effect, values: Values) -> Effect:
    """The effect with these values alone to be tried."""
    return replace(effect, further=replace(effect.further, grid=(values,)))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of cause."""

    kind: str
    # where on the way from command to reading it acts: "command", "reading", "equation" or "value" of any model; or at
    # a station of an aircraft
    place: str = "aircraft"
    make: Callable[..., Effect]  # the Effect for a target (none: "") and, where it `needs_term`, a term
    targets: tuple[str, ...]  # valid targets; empty: it has none
    quantity: str  # what its value is, with sign
    # SI unit of the value; fields channel and term stand for the units of those, gain for that of an angle over the
    # quantity `term`
    unit: str
    sentence: str  # template; fields label, term, size, percent, target; [late|early] for either sign, then without it
    title: str = "{label}: {words}"  # template of its short name; fields words (the kind), label, term, target
    needs_term: bool = False
    terms: tuple[str, ...] = ()  # valid terms, where they are no monomials: body axes
    joined: bool = False  # the target is a set of `targets` that change together, written `CL+CD`
    optional: bool = False  # the target may be left out
    of_rotors: bool = False  # a target may be a rotor of the aircraft too, by its name, or "rotors" for all
    # further parameter -> make, of another effect of this kind that has it
    variants: Mapping[str, Callable[..., Effect]] = field(default_factory=dict)
    of_systems: bool = False  # whether a diagnosis of any system looks for it by itself
    # the effects that a diagnosis of an aircraft may consider, before it is asked what is measured
    candidates: Callable[[Airframe], Iterable[Effect]]

    def effects_at(self, target: str, term: str | None) -> list[Effect]:
        """List the effects of this kind at a target and term: the usual one, and its variants."""
        place = (target, term) if term else (target,)
        return [make(*place) for make in (self.make, *self.variants.values())]

    @property
    def of_coefficients(self) -> bool:
        """Return True if its targets are aerodynamic coefficients, of which an aircraft has six."""
        return bool(self.targets) and set(self.targets) <= set(COEFFICIENTS)

    def parts(self, target: str | None) -> list[str]:
        """List what a target names: two coefficients for `CL+CD`; nothing when it is left out."""
        if not target:
            return []
        return target.split("+") if self.joined else [target]

    def unit_for(self, target: str | None, term: str | None = None) -> str:
        """SI unit of the value at a valid target and term; "" of a channel that casid does not know."""
        if "{channel}" in self.unit and not unit_of(target or ""):
            return ""
        if "{term}" in self.unit and not self.needs_term:
            term = (target or "").partition("_")[2]  # of a derivative
        per = parse_term(term).unit if term and not self.terms and self.place == "aircraft" else ""
        if self.unit == "{channel}*{term}":
            return _product(unit_of(target or ""), per)
        fed = unit_of(term) if term and self.terms and "{gain}" in self.unit else ""
        return self.unit.format(channel=unit_of(target or ""), term=per, gain="s" if fed == "rad/s" else "1")

    def term_named(self, term: str | None) -> str | None:
        """A valid term by its canonical name."""
        return parse_term(term).name if term and not self.terms and self.place == "aircraft" else term


def _product(unit: str, per: str) -> str:
    """Unit of a slope: of a channel over that of a term, whose own is "1/rad2" and the like."""
    power = int(per.removeprefix("1/rad") or 1) if per.startswith("1/rad") else 0
    if unit == "rad":
        power -= 1
        unit = "1"
    divided = "" if power == 0 else "/rad" if power == 1 else f"/rad{power}"
    return f"{unit}{divided}"


_GROUPS = (Size, Event, Further, Traits, Forms)
KINDS: dict[str, Kind] = {}  # filled by importing `casid.model.causes`


def _registered(kind: str, target: str, term: str | None, name: str) -> Effect | None:
    """The effect that the register makes under a name."""
    made = KINDS[kind].effects_at(target, term) if kind in KINDS else []
    return next((effect for effect in made if effect.name == name), None)


def _no_functions(one: Any) -> dict[str, Any]:
    """The fields that are no functions; of a group, its own such fields."""
    own = {f.name: getattr(one, f.name) for f in fields(one)}
    return {n: _no_functions(v) if isinstance(v, _GROUPS) else v for n, v in own.items() if not callable(v)}


def _with(made: Any, further: Mapping[str, Any]) -> Any:
    """Return a copy with the fields of `_no_functions`."""
    now = {name: getattr(made, name) for name in further}
    groups = {name: _with(now[name], value) for name, value in further.items() if isinstance(now[name], _GROUPS)}
    return replace(made, **{**further, **groups})


def _again(kind: str, target: str, term: str | None, name: str, further: Mapping[str, Any]) -> Effect:
    """An effect that was pickled."""
    made = _registered(kind, target, term, name)
    if made is None:
        raise InputError(f"{name}: not in the register of causes; import the module that defines it before")
    return _with(made, further)


def of_kind(kind: str) -> Callable[[Callable[..., Effect]], Callable[..., Effect]]:
    """Let the effects that a function makes for a target (and a term) have these, and a kind."""

    def register(define: Callable[..., Effect]) -> Callable[..., Effect]:
        @wraps(define)
        def make(target: str = "", term: str | None = None) -> Effect:
            made = define(*filter(None, (target, term)))
            return replace(made, kind=kind, target=made.target or target, term=made.term or term)

        return make

    return register


def cause(
    *,
    targets: Iterable[str] = (),
    terms: Iterable[str] = (),
    needs_term: bool = False,
    candidates: Callable[[Airframe], Iterable[Effect]] | None = None,
    **said: Any,
) -> Callable[[Callable[..., Effect]], Callable[..., Effect]]:
    """Register a kind of cause, see `Kind`, whose other fields are `said`: the decorated function, whose name it has,
    makes its Effect for a target (and a term). `candidates` are one effect for every target, rotor and term when they
    are not given."""
    valid = tuple(targets)
    terms = tuple(terms)

    def register(define: Callable[..., Effect]) -> Callable[..., Effect]:
        kind = define.__name__
        make = of_kind(kind)(define)

        def sought_at(aircraft: Airframe) -> Iterable[str]:
            if not said.get("of_rotors"):
                return valid or ("",)
            rotors = aircraft.rotors.names if aircraft.rotors else ()
            return (*valid, *rotors) if valid or not rotors else (*rotors, ALL)

        def one_for_each_place(aircraft: Airframe) -> Iterable[Effect]:
            every = sought_at(aircraft)
            return starmap(make, product(every, terms) if terms else product(every))

        told = {"targets": valid, "terms": terms, "needs_term": needs_term or bool(terms)}
        KINDS[kind] = Kind(kind=kind, make=make, candidates=candidates or one_for_each_place, **told, **said)
        return make

    return register
