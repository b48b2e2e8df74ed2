"""Count over seeds how often the hidden fault is found: first, or in the set of the first; sized; and what else."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.records.record import Record
from problems.systems import (
    battery_cell,
    car,
    dc_motor,
    lotka_volterra,
    pendulum_on_cart,
    quadruple_tank,
    robot_joint,
    ship,
    two_compartments,
)
from problems.systems.system import Fault, System

SYSTEMS: dict[str, System] = {
    module.SYSTEM.name: module.SYSTEM
    for module in (
        quadruple_tank,
        dc_motor,
        pendulum_on_cart,
        two_compartments,
        lotka_volterra,
        robot_joint,
        ship,
        car,
        battery_cell,
    )
}
_ATTEMPTS = 20
_SIZED = 0.1  # of the true size, or three deviations


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One hidden fault, or none, and what was said of it."""

    system: str
    seed: int
    fault: Fault | None
    result: Diagnosis

    @property
    def found(self) -> bool:
        """Named first, or in the set of the first; of clean records: nothing named and nothing unexplained."""
        if self.fault is None:
            return not self.result.causes and not self.result.unexplained
        if not self.result.causes:
            return False
        first = self.result.causes[0]
        keys = [first.key, *((o["kind"], o["target"], o["term"]) for o in first.indistinguishable_from)]
        return (self.fault.kind, self.fault.target, self.fault.term or None) in keys

    @property
    def minor(self) -> bool:
        """Whether the hidden fault is told as too small to matter: by the size that its port says matters, it is."""
        hidden = self.fault and (self.fault.kind, self.fault.target, self.fault.term)
        return any((one.kind, one.target, one.term or "") == hidden for one in self.result.minor)

    @property
    def sized(self) -> bool:
        """Its size within three deviations or a tenth; nothing to size where it is not first itself."""
        if self.fault is None or not self.result.causes:
            return False
        first = self.result.causes[0]
        if (first.kind, first.target, first.term or "") != (self.fault.kind, self.fault.target, self.fault.term):
            return False
        if self.fault.kind == "sensor_stuck":
            ends = (first.onset_s or {}).get(self.fault.records[0], (-1.0, -1.0))
            return abs(0.5 * sum(ends) - self.fault.onset) < 0.02 * SYSTEMS[self.system].duration
        off = abs(first.value - self.fault.size)
        return off <= max(3.0 * first.std, _SIZED * abs(self.fault.size))

    @property
    def extras(self) -> int:
        """Names beside the first right one, or wrong ones."""
        return len(self.result.causes) - int(self.fault is not None and self.found)


def flown(system: System, seed: int, clean: bool) -> tuple[Fault | None, list[Record]]:
    """What is hidden, and the records; another fault where the system runs off with the first."""
    for attempt in range(_ATTEMPTS):
        fault = None if clean else system.draw(seed, attempt)
        try:
            return fault, system.fly(seed, fault)
        except InputError:
            continue
    raise InputError(f"{system.name}, seed {seed}: it runs off with {_ATTEMPTS} faults; choose another seed")


def outcome(system: System, seed: int, clean: bool = False) -> Outcome:
    """Draw, fly and diagnose."""
    fault, records = flown(system, seed, clean)
    result = diagnose(system.model(), records, ports=system.ports(), library=system.library)
    return Outcome(system=system.name, seed=seed, fault=fault, result=result)
