"""Events: a jump, and what only resembles one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import extended_aircraft
from casid.diagnosis.engine import candidates as trials
from casid.diagnosis.evidence import onsets as events
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.onsets import alone, sudden
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.aerodynamics import configuration_change
from casid.model.causes.air import gust, wind_shear
from casid.model.causes.controls import effectiveness_change, stuck
from problems.do328 import do328

_T = np.arange(0.0, 40.0, 1.0 / 25.0)


def _without(drag: np.ndarray) -> Evidence:
    """A flight with further drag, seen by a model without."""
    flight = prepare(do328(), flights(seed=3, count=1, duration_s=40.0, disturbance={"dCD": drag}))
    return weigh(fit(flight, [], flight.noise()))


def _jump(onset: float) -> Attached:
    effect = configuration_change("CD")
    return Attached(effect=effect, values={"value": 0.01, "duration": 0.1}, onsets={"m1": onset})


@pytest.mark.parametrize("onset", [12.0, 20.0, 29.0])
def test_a_jump_is_sudden(onset: float) -> None:
    """Truth: of a step in the middle a cubic explains 3/4 + 7/64 = 86 %, of one nearer to an end less."""
    without = _without(0.01 * (onset < _T))
    assert sudden(without, _jump(onset)).passed


def test_a_slow_change_is_no_jump_wherever_one_is_tried() -> None:
    """Drag that grows and settles within half a minute, as with the speed."""
    evidence = _without(0.005 * (1.0 + np.sin(np.pi * (_T - 20.0) / 40.0)))
    tried = [_jump(onset) for onset in np.arange(5.0, 36.0, 5.0)]
    assert not any(sudden(evidence, one).passed for one in tried)


@pytest.mark.parametrize("seed", range(4))
def test_the_largest_gust_of_air_that_always_moves_is_no_event(seed: int) -> None:
    """Air with a correlation time of half a second, and then one gust in air at rest, of twice its r.m.s."""
    rng, step = np.random.default_rng(seed), _T[1] - _T[0]
    air = np.zeros(len(_T))
    for k in range(1, len(air)):
        air[k] = np.exp(-2.0 * step) * air[k - 1] + 2.0 * np.sqrt(1.0 - np.exp(-4.0 * step)) * rng.normal()
    at = float(_T[np.argmax(np.abs(air[100:-100])) + 100])
    one = Attached(effect=gust("z"), values={"value": 4.0, "length": 1.0}, onsets={"m1": at - 0.5})
    single = 2.0 * (1.0 - np.cos(2.0 * np.pi * np.clip(_T - at + 0.5, 0.0, 1.0)))
    assert not alone(_in_air(air), one).passed
    assert alone(_in_air(single), one).passed


def _in_air(wind: np.ndarray) -> Evidence:
    """A flight in a wind along z, seen by a model of calm air."""
    flight = prepare(do328(), flights(seed=3, count=1, duration_s=40.0, disturbance={"wind_z": wind}))
    return weigh(fit(flight, [], flight.noise()))


def test_a_shear_that_ends_is_found_to_end() -> None:
    """Truth: 7 s. Begun from one that outlasts its records, no step of a fit comes there."""
    onsets = {"m1": 6.0, "m2": 8.0}
    shear = Attached(effect=wind_shear("z"), values={"value": -0.4, "duration": 7.0}, onsets=onsets)
    endless = replace(shear, values={"value": -0.3, "duration": 1000.0})
    flight = prepare(do328(), flights([shear], seed=3, count=2))
    fitted = fit(flight, [endless], flight.noise())
    ended = trials._ended(fitted)
    assert fitted.attached[-1].values["duration"] > 900.0
    assert ended.attached[-1].values == pytest.approx(shear.values, rel=0.03)


def test_a_surface_that_rests_cannot_tell_sudden_from_slow() -> None:
    """Two doublets of the rudder: what happens between them is anyone's guess, and the event is not refused for it."""
    rudder = Attached(effect=effectiveness_change("delta_r"), values={"value": -0.3}, onsets={"m1": 8.0})
    evidence = _without(np.zeros(len(_T)))
    assert sudden(evidence, rudder).passed


@pytest.mark.parametrize(("peak", "joins"), [(12.0, True), (26.0, False), (0.0, False)])
def test_what_helps_most_at_the_end_of_a_record_is_no_event_there(
    monkeypatch: pytest.MonkeyPatch, peak: float, joins: bool
) -> None:
    """A gain that grows until the record ends, or from its beginning on, is not that of something that sets in."""
    one = Attached(effect=effectiveness_change("delta_e"), values={"value": -0.3}, onsets={"m1": 8.0})
    records = [SimpleNamespace(name=name, duration=26.0, t=np.array([100.0, 126.0])) for name in ("m1", "m2")]
    evidence = SimpleNamespace(fit=SimpleNamespace(flight=SimpleNamespace(records=records)), criteria=Criteria())
    judge = SimpleNamespace(price=10.0, drop=lambda print_, r: 1000.0 - abs(print_.onset - peak))
    prints = [SimpleNamespace(onset=float(onset)) for onset in np.arange(1.0, 28.0, 0.2)]
    monkeypatch.setattr(events, "Screen", lambda _: judge)
    monkeypatch.setattr(events, "onset_grid", lambda *_: None)
    monkeypatch.setattr(events, "fingerprints", lambda *_: prints)
    wider = events.in_its_records(evidence, one)  # pyright: ignore
    assert wider.onsets == pytest.approx({"m1": 8.0} | ({"m2": 112.0} if joins else {}))


def test_a_configuration_change_in_every_record_is_found_in_every_record() -> None:
    """Truth: lift, drag and pitching moment that jump in both records; one of them tells two thirds of it."""
    onsets = {"m1": 10.6, "m2": 15.2}
    flap = Attached(
        effect=configuration_change("CL+CD+Cm"),
        onsets=onsets,
        values={"value": 0.08, "CD": 0.007, "Cm": -0.025, "duration": 1.0},
    )
    flight = prepare(do328(), flights([flap], seed=5, count=2))
    evidence = weigh(fit(flight, [], flight.noise()))
    (found,) = events.configuration_changes(evidence)
    assert found.attached.effect.members == ("CL", "CD", "Cm")
    assert found.attached.onsets == pytest.approx(onsets, abs=1.0)


@pytest.mark.parametrize(("begun", "lasting"), [(9.0, 8.0), (13.5, 2.0)])
def test_a_stuck_surface_is_told_from_its_onset_to_its_end(begun: float, lasting: float) -> None:
    """Truth: from 12 s to 16 s. The command stands still from 5 to 15 s: any onset there explains the records, and all
    are told; the end lies within a doublet. Another duration does not move the onset."""
    true = Attached(effect=stuck("delta_e"), values={"value": 1.0, "duration": 4.0}, onsets={"m1": 12.0})
    flight = prepare(do328(), flights([true], seed=3, count=2))
    near = replace(true, onsets={"m1": begun}, values={"value": 1.0, "duration": lasting, "beside": 0.0})
    assert near.with_values({"duration": 3.0}).onsets == near.onsets
    found, intervals = events.at_peak(weigh(fit(flight, [near], flight.noise())))
    one = found.fit.attached[-1]
    assert one.values["value"] == pytest.approx(1.0, abs=0.05)
    low, high = intervals["m1"]
    first, last = events.end_intervals(found, one)["m1"]
    assert low < 6.0 and 12.0 < high < 15.4
    assert first <= 16.0 <= last and last - first < 1.2


def test_an_event_is_in_no_record_that_does_not_show_it() -> None:
    """Truth: stuck in m1 alone. In m2 the same is tried while the command stands still, where nothing can tell."""
    true = Attached(effect=stuck("delta_e"), values={"value": 1.0, "duration": 4.0}, onsets={"m1": 12.0})
    flight = prepare(do328(), flights([true], seed=3, count=2))
    near = replace(true, onsets={"m1": 12.0, "m2": 6.0})
    found = events.in_its_records(weigh(fit(flight, [near], flight.noise())), near)
    assert found.onsets == true.onsets


def test_an_onset_that_the_fit_refutes_is_not_in_the_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    """Truth: aileron at 0.8 from 8.0 s. A far peak of the linearised profile is tried by a fit, which is much worse."""
    weak = Attached(effect=effectiveness_change("delta_a"), values={"value": -0.2}, onsets={"m1": 8.0})
    flight = prepare(do328(), flights([weak], seed=3, count=2))
    evidence = weigh(fit(flight, [weak], flight.noise()))
    profile = events.moved_onsets

    def with_a_far_peak(evidence: Evidence, one: Attached, far: bool = True) -> tuple[Attached, events.Intervals]:
        if far:
            return replace(one, onsets={"m1": 21.0}), {"m1": (20.9, 21.1)}
        return profile(evidence, one, far)

    monkeypatch.setattr(events, "moved_onsets", with_a_far_peak)
    peak, interval = events.at_peak(evidence)
    low, high = interval["m1"]
    assert low <= 8.0 <= high < 12.0
    assert low <= peak.fit.attached[-1].onsets["m1"] <= high


def test_the_extended_file_flies_an_event_when_the_fit_has_it() -> None:
    """Truth: the onset of the fit. Its interval is not symmetric, as the surface rested after it."""
    onset = 6.1
    one = Attached(effect=effectiveness_change("delta_a"), values={"value": -0.19}, onsets={"m1": onset})
    cause = Cause(
        effect=one.effect,
        value=-0.19,
        std=0.01,
        records=("m1",),
        onset_s={"m1": (6.0, 20.0)},
        statistic=1e4,
        sentence="",
        meaningful=True,
        share=0.5,
    )
    fitted = SimpleNamespace(
        attached=[one], slots=(), noise=SimpleNamespace(coloured=False), batch=SimpleNamespace(names=("m1", "m2"))
    )
    (effect,) = extended_aircraft(do328(), fitted, [cause], []).effects  # pyright: ignore
    assert sum((effect.onset_s or {})["m1"]) / 2.0 == pytest.approx(onset)
