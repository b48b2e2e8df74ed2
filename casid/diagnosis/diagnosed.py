"""Describe what is diagnosed, an aircraft or any other system: as given, as extended, and the names of its values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.model.system import Model
from casid.model.usual_derivatives import missing_derivatives


@dataclass(frozen=True, eq=False, kw_only=True)
class DiagnosedAircraft:
    """Aircraft that is diagnosed: the file as given, the extended one, and the words for both."""

    file: Aircraft  # the aircraft as given
    extended: Aircraft  # the aircraft with estimated values and the named causes
    source: ClassVar[str] = "file"
    witness: ClassVar[str] = "flight"

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def kept(self) -> DiagnosedAircraft:
        """The file as given in place of the extended one."""
        return replace(self, extended=self.file)

    @property
    def values(self) -> dict[str, float]:
        """The values of the file, by name."""
        terms = {f"{c}_{term}": value for c, row in self.file.terms.items() for term, value in row.items()}
        free = [table for table in self.file.tables if table.free]
        knots = {name: value for table in free for name, value in table.knots.items()}
        found = {**self.file.derivatives, **missing_derivatives(self.file), **terms, **knots}
        for value in self.file.effects:
            name = effect_of(value).name
            found |= {name: value.value} | {f"{name}.{key}": further for key, further in value.parameters.items()}
        return found

    @property
    def told(self) -> dict[str, float]:
        """The values whose changes the account names: derivatives, without those at zero angles and rates."""
        derivatives = {**self.file.derivatives, **missing_derivatives(self.file)}
        return {name: value for name, value in derivatives.items() if not name.endswith("_0")}


@dataclass(frozen=True, eq=False, kw_only=True)
class DiagnosedSystem:
    """System that is diagnosed: the model as given, the extended one, and the words for both."""

    model: Model  # the system as given
    # with the named causes, whose sizes are parameters, and fitted values; `extended.ready(record)` feeds it
    extended: Model
    source: ClassVar[str] = "model"
    witness: ClassVar[str] = "the records"

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def kept(self) -> DiagnosedSystem:
        """The model as given in place of the extended one."""
        return replace(self, extended=self.model)

    @property
    def values(self) -> dict[str, float]:
        """The nominal values of the parameters."""
        return dict(self.model.nominal)

    @property
    def told(self) -> dict[str, float]:
        """The values whose changes the account names."""
        return self.values
