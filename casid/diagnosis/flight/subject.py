"""What a diagnosis is about: a simulation, of an aircraft or of any other system, with its prepared records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.terms import Terms
from casid.diagnosis.time_limit import TimeLimit
from casid.filtering.innovations import Batch, NoiseModel, PointFunctions, make_batch, padded
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.system import Model
from casid.native.compiler import BUILDING
from casid.records.record import Record
from casid.records.thinning import spaced

K = TypeVar("K")
V = TypeVar("V")


def once(made: dict[K, V], key: K, build: Callable[[], V]) -> V:
    """Return what is made for a key, now or before; one thread at a time builds expressions."""
    with BUILDING:
        if key not in made:
            made[key] = build()
    return made[key]


class Sizes(Protocol):
    """Measure of causes and latent inputs beside a fit, in units of the smallest size that matters."""

    def share_of(self, fit: Any, one: Any, /) -> float: ...
    def missing_share(self, fit: Any, missing: Any, /) -> float: ...
    def missing_size(self, fit: Any, missing: Any, /) -> float: ...
    def told(self, fit: Any, one: Any, std: float, /) -> tuple[float, float]: ...
    def told_at(self, fit: Any, missing: Any, /) -> Any: ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Subject:
    """A simulation and its prepared records, with what a diagnosis asks of both.

    It is made by `prepare` (`flight.py`) of an aircraft with aerodynamics, by `rotorcraft` of one with rotors, and by
    `ported` of any other model; the functions among its fields are theirs.
    """

    title: str  # name of what is simulated
    outputs: tuple[str, ...]  # channels that the model must explain
    records: tuple[Record, ...]
    sigma: dict[str, float]  # measurement noise of each output, 1-sigma
    freed: tuple[str, ...]  # parameters that are estimated
    stations: list[str]  # disturbances of the model at which something unknown may enter
    readings: list[str]  # the same of instruments
    sizes: Sizes  # measure of the sizes of causes
    build: Callable[[Subject, Sequence[Effect]], Model]  # the model with symbolic effects among its parameters
    terms_of: Callable[[Subject, Model], Terms]  # what effects of a model are made of
    catalogue: Callable[[Subject], list[Effect]]  # the causes that these records can show
    prior_of: Callable[[Subject, Model, str], float]  # 1-sigma of a parameter before the records
    # the simulation with other values of its parameters, along other records under the same noise
    elsewhere_of: Callable[[Subject, Mapping[str, float], Sequence[Record]], Subject]
    offsets: Sequence[Effect] = ()  # offsets of instruments, which are never named
    # of an aircraft: its file, the scope of the model, and the sign of the air's rotation due to the gradient of its
    # velocity, by axis (`aircraft_model`)
    file: Aircraft | None = None
    axes: str = "full"
    turning: Mapping[str, float] = field(default_factory=dict)
    # of its aerodynamics: the coefficients, those that act on states, and (coefficient, parameter, term) of each term
    coefficients: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    terms: tuple[tuple[str, str, str], ...] = ()
    lines: tuple[str, ...] = ()  # regressors that parameters multiply: a term may be nearly a line in these
    imitated: Mapping[str, Effect] = field(default_factory=dict)  # free number -> effect whose relative change it is
    # record -> (N, states) start of a fit; otherwise the model's own first guess
    paths: Mapping[str, np.ndarray] = field(default_factory=dict)
    input_sigma: dict[str, float] = field(default_factory=dict)  # noise of each recorded input, by disturbance
    white: Mapping[str, float] = field(default_factory=dict)  # disturbance -> 1-sigma of process noise
    # outputs whose high band does not show their noise (filtered, held, coarse): `sigma` is a lower bound, raised by
    # `with_noise_above`
    doubted: tuple[str, ...] = ()
    # time between the readings of doubted outputs that count [s], 0 for all readings: readings in between contain no
    # more if a filter removed everything above the band of the motion
    spacing: float = 0.0
    # output -> (1-sigma, correlation time) of its innovations, for noise that is estimated with the model
    # (`NoiseModel.colour`)
    colour: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    held: float = 0.0  # behaviour of inputs between recorded samples (`Batch.held`), for records that do not state it
    # whether a controller answers to every disturbance, so that predictions are compared with a record instead of a
    # simulation of the whole of it
    by_innovations: bool = False
    every: int = 1  # number of recorded samples of which each sample is the mean
    unknown: tuple[str, ...] = ()  # inputs that were never recorded: nothing that depends on them is judged
    limit: TimeLimit = field(default_factory=TimeLimit)  # the time that the search may take
    criteria: Criteria = Criteria()  # the thresholds for all decisions made with these records
    _models: dict[tuple[str, ...], Model] = field(default_factory=dict, repr=False)
    _functions: dict[Model, PointFunctions] = field(default_factory=dict, repr=False)
    _regressors: dict[Model, Terms] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_models": {}, "_functions": {}, "_regressors": {}}  # built again on demand

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the records."""
        return tuple(record.name for record in self.records)

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft that is simulated. Raises TypeError for another system."""
        if self.file is None:
            raise TypeError(f"'{self.title}' is no aircraft")
        return self.file

    @property
    def effects(self) -> list[Effect]:
        """The causes that are considered."""
        return self.catalogue(self)

    @property
    def imitated_names(self) -> frozenset[str]:
        """Names of effects that are a relative change of a fitted number."""
        return frozenset(effect.name for effect in self.imitated.values())

    def suspects(self, fit: Any) -> list[tuple[Effect, float, float]]:
        """(effect, value, stated 1-sigma) of every fitted number that left its stated uncertainty and is an effect.

        A number that is drawn to its stated value moves by sqrt(stated^2 - fitted^2), 1-sigma, where that is right.
        """
        found = []
        model = self.model()
        for name, make in self.imitated.items():
            if not any(slot.name == name for slot in fit.slots):
                continue
            given = model.nominal[name]
            std = self.prior_std(model, name)
            change = fit[name] - given
            moves = max(std**2 - fit.std(name) ** 2, 0.0) ** 0.5
            if abs(change) > self.criteria.significance.sigmas * moves:
                found.append((make, change / given, std / given))
        return found

    def smallest_that_matters(self, effect: Effect) -> float | None:
        """The smallest size of an effect that matters; None if it is judged by its consequences."""
        return None if self.file is None else effect.smallest_that_matters(self.file)

    def prior_std(self, model: Model, name: str) -> float:
        """Prior standard deviation of a parameter of a model."""
        return self.prior_of(self, model, name)

    @property
    def noise_by_fit(self) -> bool:
        """Return True if most outputs do not show their noise, so that its level and colour are estimated with the
        model."""
        return len(self.doubted) >= self.criteria.parts.most * len(self.outputs)

    def noise(self, coloured: dict[str, tuple[float, float]] | None = None) -> NoiseModel:
        """The noise model of readings and inputs, with `coloured` disturbances."""
        random = {"white": self.white, "inputs": self.input_sigma, "colour": self.colour}
        return NoiseModel(measurement=self.sigma, coloured=coloured or {}, **random)

    def model(self, effects: Sequence[Effect] = ()) -> Model:
        """The model with symbolic `effects` among its parameters."""
        symbolic = [effect for effect in effects if effect.symbolic]
        return once(self._models, tuple(effect.name for effect in symbolic), lambda: self.build(self, symbolic))

    def functions(self, model: Model) -> PointFunctions:
        """The functions of one of its models."""
        return once(self._functions, model, lambda: PointFunctions(model, ()))

    def regressors(self, model: Model) -> Terms:
        """The terms that effects of one of its models are made of."""
        return once(self._regressors, model, lambda: self.terms_of(self, model))

    def batch(self, model: Model) -> Batch:
        """The records as arrays, for one of its models."""
        batch = make_batch(model, self.records)
        if self.spacing:
            Z = batch.Z.copy()
            doubted = [model.outputs.index(o) for o in self.doubted]
            for j, record in enumerate(self.records):
                for i in doubted:
                    read = spaced(record.t, Z[: len(record), j, i], self.spacing)
                    Z[: len(record), j, i] = np.where(read, Z[: len(record), j, i], np.nan)
            batch = replace(batch, Z=Z)
        # Inputs that are held over a recorded interval act half of that interval late, and so do their means.
        return replace(batch, held=np.where(batch.held == 0.0, self.held, batch.held) / self.every)

    def measured(self, model: Model) -> np.ndarray:
        """(N, R, states) Measured motion, from which a fit begins; states that are not measured have those of trim."""
        known = self.paths
        return padded([known[one.name] if one.name in known else model.guess(one) for one in self.records])

    def elsewhere(self, values: Mapping[str, float], records: Sequence[Record]) -> Subject:
        """Other records with the noise of these, and the simulation with other values of its parameters."""
        return self.elsewhere_of(self, values, records)

    def changed(self, **fields: Any) -> Subject:
        """A copy with other fields, on which its models depend."""
        return replace(self, **fields, _models={}, _functions={}, _regressors={})
