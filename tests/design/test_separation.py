"""Manoeuvres that separate two causes. Truth: flights with one of them and noise, in which both are fitted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from casid.design import separation as design
from casid.design.experiment import Experiment
from casid.design.input_shapes import flyable
from casid.design.level_flight import Limits, level_rivals, plane_of
from casid.design.separation import NextFlight, NoManoeuvre, Rivals, separating_manoeuvre, separation
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_named, effect_value
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import THRUST, V_TRIM, do328

NOISE = {"V": 0.3, "alpha": 0.0026, "q": 0.0009, "theta": 0.0009, "ax": 0.05, "az": 0.08}
LIMITS = Limits(surfaces={"delta_e": np.radians(3.0)}, channels={"alpha": np.radians(3.0), "az": 5.0}, duration=10.0)


@cache
def aircraft() -> Aircraft:
    level = trim(do328(), V=V_TRIM, thrust=THRUST)
    return replace(do328(), trim={"V": level.V, "rho": level.rho})


@cache
def rivals() -> tuple[Rivals, Experiment]:
    """A lag and a delay of the elevator: what is slow leaves them alike."""
    lag, delay = effect_value("actuator_lag(delta_e)=0.1"), effect_value("input_delay(delta_e)=0.1")
    return level_rivals(aircraft(), lag, delay, LIMITS, NOISE)


@cache
def designed() -> NextFlight:
    found = separating_manoeuvre(*rivals())
    assert isinstance(found, NextFlight)
    return found


def sluggish() -> Record:
    """Ten times slower than the short period, at the same limit of the angle of attack."""
    record = rivals()[1].record({}, "sluggish")
    move = 0.03 * np.sin(2.0 * np.pi * 0.1 * record.t) * np.minimum(1.0, record.t / 3.0)
    return record.with_channels(delta_e=record["delta_e"] + move)


def test_a_sluggish_input_does_not_separate_lag_from_delay_and_the_designed_one_does() -> None:
    assert separation(rivals()[0], [sluggish()]).log_odds < 3.0
    assert designed().separation.log_odds > 100.0


@pytest.mark.parametrize("manoeuvre", ["designed", "sluggish"])
def test_what_is_promised_is_what_fits_of_flown_records_find(manoeuvre: str) -> None:
    """The lag flies, with noise; both are fitted. Half the difference of their deviances scatters about the promise
    as it says, of an input that tells nearly nothing too."""
    flown, found = designed().flown, []
    told = separation(rivals()[0], [sluggish()]) if manoeuvre == "sluggish" else designed().separation
    if manoeuvre == "sluggish":
        flown = sluggish().with_channels(**dict(zip(told.told, told.first["sluggish"].T, strict=True)))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        read = {o: flown[o] + rng.normal(0.0, sigma, len(flown)) for o, sigma in NOISE.items()}
        flight = prepare(replace(aircraft(), noise=NOISE), [flown.with_channels(**read)], axes="longitudinal")
        deviance = [
            fit(flight, [Attached(effect=effect_named(name), values={"value": 0.1})], flight.noise()).data_deviance
            for name in ("actuator_lag(delta_e)", "input_delay(delta_e)")
        ]
        found.append(0.5 * (deviance[1] - deviance[0]))
    assert np.mean(found) == pytest.approx(told.log_odds, abs=3.0 * told.scatter / np.sqrt(3.0))


def test_the_manoeuvre_keeps_its_limits_and_uses_one_of_them() -> None:
    one = designed()
    assert one.amplitude <= LIMITS.surfaces["delta_e"] * 1.001
    used = [np.abs(one.flown[o] - one.flown[o][0]).max() / limit for o, limit in LIMITS.channels.items()]
    used.append(np.abs(one.record["delta_e"] - one.record["delta_e"][0]).max() / LIMITS.surfaces["delta_e"])
    assert max(used) == pytest.approx(1.0, abs=0.02)


@settings(max_examples=12, deadline=None)
@given(
    Cm_alpha=st.sampled_from([-1.7, -0.1, 0.08, 1.0, 6.0, 60.0]),
    Cm_q=st.sampled_from([-26.0, 5.0, 200.0]),
    moment=st.sampled_from([0.0, 1e-3, 0.02, 1.0]),
    alpha=st.sampled_from([1e-4, 1e-2, 0.1]),
    duration=st.sampled_from([4.0, 20.0]),
)
def test_the_search_ends_of_any_aircraft(
    Cm_alpha: float, Cm_q: float, moment: float, alpha: float, duration: float
) -> None:
    """Stable, unstable or divergent, in trim or drifting from it: as many flights as manoeuvres allow at most, then one
    within the limits or a reason."""
    level = trim(do328(), V=V_TRIM, thrust=THRUST)
    own = do328()
    plane = replace(
        own,
        derivatives={**own.derivatives, "Cm_alpha": Cm_alpha, "Cm_q": Cm_q},
        trim={"V": level.V, "rho": level.rho},
    )
    first, second = effect_value(f"moment_reference(x)={moment or 1e-9}"), effect_value("actuator_lag(delta_e)=0.1")
    limits = Limits(surfaces={"delta_e": 0.05}, channels={"alpha": alpha, "az": 5.0}, duration=duration)
    own_rivals, experiment = level_rivals(plane, first, second, limits, NOISE)
    most = 20 * len(list(flyable(experiment)))
    flown = 0
    fly = design._trajectory

    def counted(*arguments: object) -> object:
        nonlocal flown
        flown += 1
        assert flown < most
        return fly(*arguments)  # pyright: ignore[reportArgumentType]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "_trajectory", counted)
        found = separating_manoeuvre(own_rivals, experiment)
    if isinstance(found, NoManoeuvre):
        assert found.reason
        return
    moved = np.abs(found.flown["alpha"] - found.flown["alpha"][0]).max()
    assert moved <= 1.02 * alpha
    assert 0.0 < found.amplitude <= 0.05


def test_no_flyable_manoeuvre_is_better() -> None:
    """The search leaves out what cannot win; here every doublet is weighed."""
    own, experiment = rivals()
    others = [one for one in flyable(experiment) if one.words.startswith("doublet")]
    level = experiment.record({}, "others")
    records = [
        level.with_channels(delta_e=level["delta_e"] + 0.5 * designed().amplitude * one.moves) for one in others[::3]
    ]
    assert all(separation(own, [record]).log_odds < designed().separation.log_odds for record in records)


def test_two_flights_tell_more_than_one() -> None:
    own, _ = rivals()
    twice = separation(own, [designed().record, sluggish()]).log_odds
    assert twice >= designed().separation.log_odds * 0.999


def test_an_event_is_refused_as_no_manoeuvre_brings_it_back() -> None:
    lag, gust = effect_value("actuator_lag(delta_e)=0.1"), effect_value("gust(z)=2")
    with pytest.raises(InputError, match="no manoeuvre"):
        level_rivals(aircraft(), lag, gust, LIMITS, NOISE)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("actuator_lag(delta_e)", "size in SI"),
        ("actuator_lag(delta_e)=fast", "size in SI"),
        ("actuator_lug(delta_e)=1", "actuator_lag"),
        ("actuator_lag(delta_x)=1", "delta_"),
        ("aero_term(Cm)=1", "term"),
        ("unsteady_aero(Cm, lugged)=1", "lagged"),
    ],
)
def test_causes_that_do_not_exist_are_refused_with_the_nearest(text: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        effect_value(text)


@pytest.mark.parametrize(
    ("names", "plane"),
    [
        (("delta_e", "Cm"), "longitudinal"),
        (("delta_r", "Cl", "beta"), "lateral"),
        (("delta_e", "delta_a"), "full"),
        (("inertial",), "full"),
        ((), "full"),
    ],
)
def test_the_plane_of_motion_is_that_of_all_names(names: tuple[str, ...], plane: str) -> None:
    assert plane_of(*names) == plane
