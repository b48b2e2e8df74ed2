"""Adding a cause is one definition: a tilted rate gyro, defined in this file and nowhere else, is accepted in an
aircraft file, simulated, estimated, named by the diagnosis and written into the extended file.

The truth is its formula, put into the records by hand: the gyro of one axis senses a part of the rate about another.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from small_flight import NAMES, aircraft_file, records

from casid.diagnosis.diagnose import diagnose
from casid.errors import InputError
from casid.estimation import MultipleShooting, Problem, solve
from casid.model.aircraft import Aircraft
from casid.model.effect import KINDS, Effect, Size, Symbols, Traits, cause
from casid.model.flown_records import flown_records, with_estimates
from casid.model.path import SignalPath
from casid.model.simulate import simulate
from casid.records.record import Record

TILT = 0.06  # rad
ENTRY = """
[[effects]]
kind = "gyro_tilt"
target = "q"
value = {value}
"""


@pytest.fixture(autouse=True)
def gyro_tilt() -> Iterator[None]:
    """The one definition."""

    @cause(
        targets=("p", "q", "r"),
        unit="rad",
        quantity="angle towards the axis whose rate it senses",
        sentence="The gyro of the {label} is tilted by {size}, and senses a part of another rate.",
    )
    def gyro_tilt(rate: str) -> Effect:
        sensed = {"p": "q", "q": "p", "r": "p"}[rate]

        def change(path: SignalPath, values: Symbols) -> None:
            path.output[rate] += values["value"] * path.state[sensed]

        return Effect(
            reads=(rate,),
            kinematic=True,
            traits=Traits(by_record=True),
            station="sensors",
            change=change,
            size=Size(meaningful=0.01, limit=0.5),
        )

    yield
    del KINDS["gyro_tilt"]


def tilted_records(seed: int = 7) -> list[Record]:
    """The small flight as a tilted gyro reads it."""
    return [record.with_channels(q=record["q"] + TILT * record["p"]) for record in records(seed)]


def file_with(value: float, folder) -> Aircraft:
    aircraft_file().with_terms({"Cm": {"alpha^2": 8.0}}).write(folder / "plain.toml")
    text = (folder / "plain.toml").read_text() + ENTRY.format(value=value)
    (folder / "tilted.toml").write_text(text)
    return Aircraft.read(folder / "tilted.toml")


def test_it_is_accepted_in_an_aircraft_file(tmp_path):
    (effect,) = file_with(TILT, tmp_path).effects
    assert (effect.kind, effect.target, effect.value, effect.unit) == ("gyro_tilt", "q", TILT, "rad")
    wrong = (tmp_path / "tilted.toml").read_text().replace('"gyro_tilt"', '"gyro_tild"')
    (tmp_path / "wrong.toml").write_text(wrong)
    with pytest.raises(InputError, match="unknown effect kind 'gyro_tild'; did you mean 'gyro_tilt'"):
        Aircraft.read(tmp_path / "wrong.toml")


def test_it_is_simulated_and_estimated(tmp_path):
    applied = flown_records(file_with(TILT, tmp_path), records())
    record, i = applied.records[0], applied.model.outputs.index
    flown = simulate(applied.model, record, applied.model.guess(record)[0])
    tilted = flown.state("q") + TILT * flown.state("p")
    np.testing.assert_allclose(flown.outputs[:, i("q")], tilted, atol=1e-14)
    guessed = file_with(0.0, tmp_path)
    applied = flown_records(guessed, tilted_records())
    fit = solve(Problem(applied.model, applied.records, free=["gyro_tilt*"]), MultipleShooting())
    found = fit["gyro_tilt(q)"]
    assert fit.converged and abs(found.value - TILT) < 4.0 * found.std < 0.2 * TILT
    (written,) = with_estimates(guessed, fit.values, {n: e.std for n, e in fit.parameters.items()}).effects
    assert (written.value, written.std) == (found.value, found.std)


def test_it_is_named_and_written_into_the_extended_file(tmp_path):
    believed = aircraft_file().with_terms({"Cm": {"alpha^2": 8.0}})
    found = diagnose(believed, tilted_records(), hold_out=held_out())
    assert found.verdict == "explained", str(found)
    (named,) = found.causes
    assert (named.kind, named.target, named.records) == ("gyro_tilt", "q", NAMES)
    assert abs(named.value - TILT) < 4.0 * named.std
    assert named.sentence == "The gyro of the pitch rate is tilted by 3.4 deg, and senses a part of another rate."
    assert named.held_out_gain is not None and named.held_out_gain > 0.0
    assert "gyro_tilt(p)" in found.detectable, "what was not there has a smallest detectable size"
    found.extended_aircraft.write(tmp_path / "extended.toml")
    extended = Aircraft.read(tmp_path / "extended.toml")
    assert extended.effects == found.extended_aircraft.effects and extended.effects[0].kind == "gyro_tilt"
    assert simulated_rms(extended) < 0.2 * simulated_rms(believed)


def held_out() -> list[Record]:
    """Two further flights, other noise, under other names."""
    return [Record(name=f"further {r.name}", t=r.t, channels=r.channels) for r in tilted_records(seed=8)]


def simulated_rms(aircraft: Aircraft) -> float:
    """r.m.s. of q over a record that was never fitted, flown open loop."""
    applied = flown_records(aircraft, held_out()[:1])
    record = applied.records[0]
    flown = simulate(applied.model, record, applied.model.guess(record)[0])
    return float(np.sqrt(np.mean((record["q"] - flown.output("q")) ** 2)))
