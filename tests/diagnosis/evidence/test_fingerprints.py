"""The fingerprint of a cause gives its size. The truth is the size that was flown, from an extended aircraft file."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_flights import NOISE, SURFACE_NOISE, multistep

from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import fingerprints, products_at
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.errors import InputError
from casid.model.aircraft import EffectValue
from casid.model.causes.instruments import structural_mode
from casid.model.dynamics import aircraft_model
from casid.model.effect import with_grid
from casid.model.effects import catalogue, effect_of
from casid.model.flown_records import flown_records
from casid.model.simulate import simulate
from casid.model.station import coefficient
from casid.model.trim import trim
from casid.records.record import Record
from casid.records.thinning import thinned
from problems.do328 import THRUST, V_TRIM, do328

MEMORY = EffectValue(kind="unsteady_aero", target="Cm", value=-8.0, parameters={"time_constant": 0.3})
FLOWN = [
    MEMORY,
    EffectValue(kind="unsteady_aero", target="Cn", value=0.4, parameters={"time_constant": 0.3}),
    EffectValue(kind="sensor_scale", target="inertial", value=0.02),
    EffectValue(kind="structural_mode", target="alpha", value=0.01, parameters={"frequency_hz": 4.0, "damping": 0.03}),
    EffectValue(kind="structural_mode", target="ay", value=0.4, parameters={"frequency_hz": 5.0, "damping": 0.03}),
    EffectValue(kind="structural_mode", target="ax", value=0.4, parameters={"frequency_hz": 3.0, "damping": 0.03}),
]
_3211, _DOUBLET = ((3, 1), (2, -1), (1, 1), (1, -1)), ((1, 1), (1, -1))


def flights(effect: EffectValue, seed: int) -> list[Record]:
    """Two records of 16 s at 50 Hz of the aircraft file with the effect, noise on all that is measured."""
    level, t = trim(do328(), V=V_TRIM, thrust=THRUST), np.arange(0.0, 16.0, 0.02)
    rng, found = np.random.default_rng(seed), []
    for name, sign in (("m1", 1.0), ("m2", -1.0)):
        channels = {key: np.full(len(t), value) for key, value in level.inputs.items()}
        channels["delta_e"] += sign * (0.035 * multistep(t, 1.0, _3211, 0.5) + 0.03 * multistep(t, 13.0, _DOUBLET, 0.5))
        channels["delta_a"] += sign * 0.04 * multistep(t, 5.0, _3211, 0.4)
        channels["delta_r"] += sign * 0.05 * multistep(t, 8.5, _3211, 0.5)
        commanded = Record(name=name, t=t, channels=channels)
        calm = simulate(aircraft_model(do328()), commanded, level.state).as_record()
        applied = flown_records(do328().with_effects([effect]), [calm])
        start = np.concatenate([level.state, applied.model.guess(calm)[0, len(level.state) :]])
        flown = simulate(applied.model, applied.records[0], start, substeps=2)
        read = dict(zip(applied.model.outputs, flown.outputs.T, strict=True))
        noisy = {o: read[o] + rng.normal(0.0, s, len(t)) for o, s in NOISE.items()}
        noisy |= {s: channels[s] + rng.normal(0.0, SURFACE_NOISE, len(t)) for s in ("delta_e", "delta_a", "delta_r")}
        found.append(Record(name=name, t=t, channels={**channels, **noisy}))
    return found


def baseline(effect: EffectValue, seed: int = 21) -> tuple[FlightFit, Evidence]:
    flight = prepare(do328(), flights(effect, seed))
    base = fit(flight, (), flight.noise())
    return base, weigh(base, discrepancy=False)


@pytest.mark.parametrize("flown", FLOWN, ids=lambda e: f"{effect_of(e).name}")
def test_a_fingerprint_gives_the_size_that_was_flown(flown: EffectValue) -> None:
    """Linear prediction at the true further parameters: within 5 sigma, and 5 % for what the linearisation leaves."""
    base, evidence = baseline(flown)
    wanted = effect_of(flown)
    (one,) = [e for e in catalogue(base.flight.aircraft, base.flight.outputs) if e.name == wanted.name]
    prints = fingerprints(evidence, [with_grid(one, flown.parameters)])
    statistic, size, std, _ = Screen(evidence).score(prints, np.ones((1, 2)))
    assert statistic > 50.0, "too small to be a test"
    assert abs(size - flown.value) < 5.0 * std + 0.05 * abs(flown.value)


def test_size_and_memory_of_lagged_aerodynamics_are_fitted() -> None:
    base, _ = baseline(MEMORY)
    start = Attached(effect=effect_of(MEMORY), values={"value": -4.0, "time_constant": 0.15})
    found = fit(base.flight, [start], base.noise, base, extent=(15, 0.5))
    for slot, truth in (("", MEMORY.value), (".time_constant", 0.3)):
        name = f"unsteady_aero(Cm, lagged){slot}"
        assert abs(found[name] - truth) < 4.0 * found.std(name) + 0.02 * abs(truth), name


def test_an_oscillation_too_fast_for_the_samples_is_not_looked_for() -> None:
    """At 5 Hz half of the frequencies that are tried make more than one cycle between samples. Nothing is known there
    of what drives it, and its reading is refused."""
    flight = prepare(do328(), [thinned(record, 5.0) for record in flights(FLOWN[3], 21)])
    base = fit(flight, (), flight.noise())
    effect = structural_mode("alpha")
    tried = [one.values["frequency_hz"] for one in fingerprints(weigh(base), [effect])]
    assert 0 < len(tried) < len(effect.further.grid) and max(tried) <= 5.0
    fast = Attached(effect=effect, values={"value": 0.01, "frequency_hz": 5.1, "damping": 0.03})
    with pytest.raises(InputError, match="5.1 Hz.*up to 5 Hz"):
        fit(flight, [fast], base.noise, base)


@pytest.mark.parametrize("damping", [0.03, 0.2])
def test_a_fit_of_an_oscillation_stays_where_the_samples_tell_of_it(damping: float) -> None:
    """Truth: there is none. A fit that stepped to 1e10 Hz asked for 36 TB, and one to a damping of -1.6 was named."""
    flight = prepare(do328(), flights(MEMORY, 21))
    base = fit(flight, (), flight.noise())
    start = Attached(effect=structural_mode("q"), values={"value": 0.05, "frequency_hz": 20.0, "damping": damping})
    found = fit(flight, [start], base.noise, base, extent=(15, 0.5)).attached[0].values
    assert 0.0 < found["frequency_hz"] <= 50.0 and found["damping"] >= 0.0


def test_records_gone_through_one_by_one_give_the_same_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums over long records are gathered from a few records at a time."""
    base, found = baseline(MEMORY)[0], []
    evidence = weigh(base)
    series = {coefficient("Cm"): np.random.default_rng(1).standard_normal((*base.batch.live.shape, 2))}
    for samples, parts in ((10**6, 1), (1, 2)):
        monkeypatch.setattr("casid.diagnosis.evidence.evidence.WHOLE", samples)
        assert len(list(evidence.in_records())) == parts
        prints = fingerprints(evidence, base.flight.effects)
        sums = [np.concatenate([one.square, one.cross.ravel(), one.match]) for one in prints]
        cross, match = products_at(evidence, series)[coefficient("Cm")]
        found.append((np.stack(sums), cross, match))
    for whole, parts in zip(*found, strict=True):
        np.testing.assert_allclose(parts, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
