"""Sizes of effects as parameters. Truth: differences of the series, and flights with another size."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import EstimationError, InputError
from casid.model.causes import KINDS
from casid.model.dynamics import flight_inputs
from casid.model.effects import effect_of
from casid.model.in_force import History, InForce, known_of
from problems.do328 import do328

T = 0.02 * np.arange(500)
START = cs.trim(do328(), V=144.0, thrust=10e3)
NOISE = {"V": 0.2, "alpha": 2e-3, "beta": 2e-3, "p": 2e-3, "q": 2e-3, "r": 2e-3, "phi": 2e-3, "theta": 2e-3}
NOISE |= {"ax": 0.03, "ay": 0.03, "az": 0.05, "pdot": 0.01, "qdot": 0.01, "rdot": 0.01}


def commanded(name: str, phase: float = 0.0) -> cs.Record:
    """Quick and slow movements of all surfaces about the trim of the Do 328."""
    channels = {n: np.full(len(T), v) for n, v in START.inputs.items()}
    for i, surface in enumerate(("delta_e", "delta_a", "delta_r")):
        steps = np.sign(np.sin(2.0 * np.pi * (0.35 + 0.12 * i) * T + phase + i)) * (T > 1.0) * (8.5 + 0.3 * i > T)
        smooth = np.convolve(steps, np.ones(9) / 9.0, mode="same")
        channels[surface] = channels[surface] + 0.03 * smooth + 0.005 * np.sin(1.3 * T + i + phase)
    return cs.Record(name=name, t=T, channels=channels)


def flown(aircraft: cs.Aircraft, record: cs.Record, seed: int) -> cs.Record:
    """What the instruments of an aircraft with its effects read, with noise."""
    measured = cs.simulate(cs.aircraft_model(do328(), effects=()), record, START.state).as_record()
    model = cs.aircraft_model(aircraft)
    start = np.concatenate([START.state, model.guess(model.ready(measured))[0, len(START.state) :]])
    read = cs.simulate(model, measured, start).as_record()
    rng = np.random.default_rng(seed)
    noisy = {name: read[name] + sigma * rng.standard_normal(len(T)) for name, sigma in NOISE.items()}
    return read.with_channels(**noisy)


def value(kind: str, target: str = "", size: float = 0.0, **more: Any) -> cs.EffectValue:
    return cs.EffectValue(kind=kind, target=target, value=size, **more)


# kind, true size, start: 1.5 to 5 times apart
HIDDEN = [
    (value("actuator_lag", "delta_e", 0.2), 0.05),
    (value("second_order_actuator", "delta_a", 0.09, parameters={"damping": 0.6}), 0.03),
    (value("input_delay", "delta_r", 0.12), 0.03),
    (value("rate_limit", "delta_e", 0.2), 0.08),  # above the rates of the command it would not act at all
    (value("dead_zone", "delta_e", 0.012, parameters={"about": 1.0}), 0.004),
    (value("backlash", "delta_a", 0.012, parameters={"rest": 0.0}), 0.004),
    (value("hysteresis", "delta_a", 0.012, parameters={"stroke": 0.03, "rest": 0.0}), 0.004),
    (value("sensor_delay", "q", 0.1), 0.03),
    (value("sensor_lag", "alpha", 0.15), 0.05),
    (value("sensor_scale", "az", 0.15), 0.04),
    (value("sensor_bias", "theta", 0.02), 0.005),
    (value("structural_mode", "q", 0.08, parameters={"frequency_hz": 3.0, "damping": 0.03}), 0.02),
    (value("gust", "z", 6.0, onset_s={"m1": (4.0, 4.0)}, parameters={"length": 1.6}), 2.0),
    (value("effectiveness_change", "delta_e", -0.4, onset_s={"m1": (5.0, 5.0)}), -0.1),
]
WAYS = [
    (cs.MultipleShooting(), cs.GaussNewton()),
    (cs.SingleShooting(), cs.GaussNewton()),
    (cs.MultipleShooting(interval=50), cs.Ipopt()),
    (cs.SingleShooting(), cs.Ipopt()),
]


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "start"), HIDDEN, ids=lambda one: getattr(one, "kind", ""))
def test_a_size_is_found_by_every_way_to_estimate(hidden: cs.EffectValue, start: float) -> None:
    """Derivatives free, two records with noise; the start itself is many standard deviations away."""
    records = [flown(do328().with_effects([hidden]), commanded(f"m{i + 1}", 0.7 * i), i) for i in range(2)]
    model = cs.aircraft_model(do328().with_effects([replace(hidden, value=start)]))
    name = effect_of(hidden).name
    for method, solver in WAYS:
        problem = cs.Problem(model, records, free=[name, "C*_alpha", "C*_delta_*", "Cm_*", "Cl_*"], noise=NOISE)
        fit = cs.solve(problem, method, solver)
        assert fit.converged, f"{method} {solver} {fit.status}"
        found = fit.parameters[name]
        assert abs(found.value - hidden.value) < max(3.0 * found.std, 0.03 * abs(hidden.value)), f"{method} {solver}"
        assert abs(start - hidden.value) > 5.0 * found.std


def test_a_size_is_estimated_beside_a_limit_and_a_prior() -> None:
    """A lag of 0.2 s: free it is found, under a limit of 0.15 s it stands at the limit."""
    hidden = value("actuator_lag", "delta_e", 0.2)
    record = flown(do328().with_effects([hidden]), commanded("m1"), 0)
    model = cs.aircraft_model(do328().with_effects([replace(hidden, value=0.05, std=1.0)]), axes="longitudinal")
    name = "actuator_lag(delta_e)"
    noise = {output: NOISE[output] for output in model.outputs}
    problem = cs.Problem(model, [record], free=[name], noise=noise, prior=True)
    free = cs.solve(problem)
    assert free.values[name] == pytest.approx(0.2, abs=3.0 * free.parameters[name].std)
    limited = cs.solve(replace(problem, constraints=[cs.limit_parameter(name, upper=0.15)]))
    assert limited.values[name] == pytest.approx(0.15, abs=1e-6)
    assert limited.log_likelihood < free.log_likelihood - 10.0


def histories() -> list[tuple[str, History, cs.Record]]:
    """Of every kind of the catalogue that makes series of a record, one with typical sizes."""
    plain = cs.simulate(cs.aircraft_model(do328(), effects=()), commanded("m1"), START.state).as_record()
    record = flight_inputs(do328(), plain)
    known = known_of(record)
    found = []
    for kind in KINDS.values():
        places = product(kind.targets[:1], kind.terms) if kind.needs_term else product(kind.targets[:1])
        for effect in [*kind.candidates(do328()), *(kind.make(*place) for place in places)]:
            if effect.change is not None or effect.stochastic or effect.series is None and effect.output is None:
                continue
            size = next((g for g in effect.further.grid if g.get("value")), {"value": 0.3})
            size = {"value": 0.3, **effect.further.defaults, **(effect.further.grid or ({},))[0], **size}
            onset = {"m1": (4.013, 4.013)} if effect.timed else None
            further = {name: one for name, one in size.items() if name != "value"}
            term = {"term": effect.term} if effect.term else {}
            own = value(effect.kind, effect.target, size["value"], onset_s=onset, parameters=further, **term)
            in_force = InForce(effect=effect, name=effect.name, value=own)
            made = History(of=in_force, stations=())
            found.append((effect.name, made, record))
            break
    assert known
    return found


def test_derivatives_by_every_size_are_exact() -> None:
    """Against differences of the series to the side that they have, to rounding of these."""
    seen = set()
    for name, history, record in histories():
        sizes = {parameter: one * 1.0137 for parameter, one in history.of.parameters.items()}
        _, slopes = history.at(record, sizes)
        for parameter in sizes:
            h = 1e-6 * max(abs(sizes[parameter]), 1e-2)
            up, down = (history.at(record, {**sizes, parameter: sizes[parameter] + d})[0] for d in (h, -h))
            for station, slope in slopes.get(parameter, {}).items():
                expected = (up[station] - down[station]) / (2.0 * h)
                scale = max(np.abs(expected).max(), 1e-9)
                off = np.abs(slope - expected) > 1e-5 * scale
                assert off.mean() < 0.02, f"{name} by {parameter} at {station}"  # a kink between two differences
                seen.add(history.of.effect.kind)
    assert seen >= {"actuator_lag", "input_delay", "rate_limit", "dead_zone", "backlash", "structural_mode", "gust"}
    assert seen >= {"wind_shear", "stuck", "effectiveness_change", "sensor_delay", "clock_drift"}
    assert seen >= {"hysteresis", "second_order_actuator", "input_limit", "input_offset", "input_scale", "sensor_stuck"}


def second_order() -> cs.Model:
    """A mass on a spring with friction."""
    return cs.define_model(
        "mass",
        states=["x", "v"],
        inputs=["u"],
        parameters={"k": 4.0, "c": 0.4},
        outputs=["x", "v"],
        dynamics=lambda s: {"x": s.v, "v": s.u - s.k * s.x - s.c * s.v},
        output=lambda s: {"x": s.x, "v": s.v},
    )


def pushed(name: str) -> cs.Record:
    return cs.Record(name=name, t=T, channels={"u": np.sign(np.sin(1.1 * T)) + 0.3 * np.sin(3.0 * T)})


PORTS = [
    (value("actuator_lag", "u", 0.3), 0.1),
    pytest.param(value("input_delay", "u", 0.15), 0.04, marks=pytest.mark.slow),
    (value("dead_zone", "u", 0.2, parameters={"about": 0.0}), 0.05),
    (value("second_order_actuator", "u", 0.2, parameters={"damping": 0.5}), 0.06),
    (value("rate_limit", "u", 2.0), 6.0),
    pytest.param(value("backlash", "u", 0.2, parameters={"rest": 0.0}), 0.05, marks=pytest.mark.slow),
    (value("hysteresis", "u", 0.3, parameters={"stroke": 0.8}), 0.1),
    (value("hysteresis", "v", 0.3, parameters={"travel": 0.15}), 0.1),
    pytest.param(value("input_scale", "u", 0.2), 0.0, marks=pytest.mark.slow),
    pytest.param(value("input_offset", "u", 0.3), 0.0, marks=pytest.mark.slow),
    pytest.param(value("input_limit", "u", 0.7, term="above"), 1.1, marks=pytest.mark.slow),
    (value("sensor_bias", "x", 0.1), 0.0),
    (value("sensor_bias", "u", 0.2), 0.0),
    pytest.param(value("sensor_scale", "u", 0.1), 0.0, marks=pytest.mark.slow),
    (value("sensor_delay", "x", 0.08), 0.02),
    (value("sensor_delay", "u", 0.08), 0.02),
    pytest.param(value("sensor_lag", "v", 0.2), 0.05, marks=pytest.mark.slow),
    (value("missing_term", "v", -0.8, term="x^3"), 0.0),
    pytest.param(value("missing_term", "v", -0.5, term="v*|v|"), 0.0, marks=pytest.mark.slow),
    (value("parameter_change", "c", 0.3, records=("m2",)), 0.0),
    (value("dry_friction", "v", 0.3, parameters={"creep": 0.05}), 0.0),
    pytest.param(value("damping", "v", 0.5), 0.0, marks=pytest.mark.slow),
    pytest.param(value("cross_damping", "v", 1.0, term="x"), 0.0, marks=pytest.mark.slow),
    pytest.param(value("relaxation", "v", 0.5, parameters={"level": 0.3}), 0.0, marks=pytest.mark.slow),
    (value("inertia_scale", "v", 0.5), 0.0),
    pytest.param(value("parameter_split", "c", 0.4, term="v"), 0.0, marks=pytest.mark.slow),
    (value("common_factor", "k+c", 0.5), 0.0),
]


@pytest.mark.parametrize(("hidden", "start"), PORTS, ids=lambda one: getattr(one, "kind", "") or "from")
def test_a_size_is_found_at_a_port_of_any_model(hidden: cs.EffectValue, start: float) -> None:
    truth = second_order().with_effects([hidden])
    rng = np.random.default_rng(3)
    records = []
    for name in ("m1", "m2"):
        begin = np.zeros(len(truth.states))
        read = cs.simulate(truth, pushed(name), begin, substeps=4).as_record()
        records.append(read.with_channels(**{o: read[o] + 0.01 * rng.standard_normal(len(T)) for o in ("x", "v")}))
    model = second_order().with_effects([replace(hidden, value=start)])
    name = effect_of(hidden).name
    beside = "c" if hidden.kind == "cross_damping" else "k"  # which is that of x itself
    fit = cs.solve(cs.Problem(model, records, free=[name, beside], noise={"x": 0.01, "v": 0.01}))
    assert fit.converged, fit.status
    found = fit.parameters[name]
    told = effect_of(hidden).in_words({"value": found.value})["value"]
    assert abs(told - hidden.value) < 4.0 * found.std
    assert abs(start - hidden.value) > 5.0 * found.std
    written = cs.simulate(truth, pushed("m1"), np.zeros(len(truth.states))).outputs
    assert written.shape == (len(T), 2)


STRIBECK = {"creep": 0.2, "at_rest": 0.4, "falls_over": 0.6}
FORCES = [  # acceleration at x, v, u with k, c and the sizes
    (value("missing_term", "v", 0.3, term="u*|v|"), lambda x, v, u, k, c, d: by_file(x, v, u, k, c) + d * u * abs(v)),
    (value("damping", "v", 0.3), lambda x, v, u, k, c, d: u - k * x - (c + d) * v),
    (value("cross_damping", "v", 0.3, term="x"), lambda x, v, u, k, c, d: u - (k + d) * x - c * v),
    (
        value("relaxation", "v", 0.3, parameters={"level": 2.0}),
        lambda x, v, u, k, c, d, to: by_file(x, v, u, k, c) + d * (to - v),
    ),
    (value("inertia_scale", "v", 0.3), lambda x, v, u, k, c, d: by_file(x, v, u, k, c) / (1.0 + d)),
    (value("parameter_split", "c", 0.3, term="v"), lambda x, v, u, k, c, d: by_file(x, v, u, k, c + d)),
    (value("parameter_split", "c", 0.3, term="x"), lambda x, v, u, k, c, d: by_file(x, v, u, k, c + 0.0 * d)),
    (value("common_factor", "k+c", 0.3), lambda x, v, u, k, c, d: by_file(x, v, u, k * (1.0 + d), c * (1.0 + d))),
    (
        value("dry_friction", "v", 0.3, parameters={"creep": 0.2}),
        lambda x, v, u, k, c, d, creep: by_file(x, v, u, k, c) - d * np.tanh(v / creep),
    ),
    (
        value("dry_friction", "v", 0.3, parameters=STRIBECK),
        lambda x, v, u, k, c, d, creep, more, over: (
            by_file(x, v, u, k, c) - (d + more * np.exp(-((v / over) ** 2))) * np.tanh(v / creep)
        ),
    ),
]


def by_file(x: Any, v: Any, u: Any, k: Any, c: Any) -> Any:
    return u - k * x - c * v


@pytest.mark.parametrize(("stated", "force"), FORCES, ids=lambda one: getattr(one, "kind", ""))
def test_an_equation_has_its_effect_and_the_derivatives_by_all_sizes(stated: cs.EffectValue, force: Any) -> None:
    """Truth: the acceleration by its formula, and complex steps along that."""
    model = second_order().with_effects([stated])
    rate = ca.Function("rate", [model.x, model.u, model.p], [model.f[1], ca.jacobian(model.f[1], model.p)])
    p = model.nominal_vector()
    for x, v, u in np.random.default_rng(5).normal(size=(20, 3)):
        found, slopes = rate([x, v], [u], p)
        steps = [np.imag(force(x, v, u, *(p + 1e-20j * row))) / 1e-20 for row in np.eye(len(p))]
        assert float(found) == pytest.approx(force(x, v, u, *p), rel=1e-12, abs=1e-12)
        np.testing.assert_allclose(slopes.full().ravel(), steps, rtol=1e-9, atol=1e-12)


def test_an_equation_without_the_state_or_the_size_of_an_effect_is_said() -> None:
    with pytest.raises(InputError, match="unknown state 'w'.*: v, x"):
        second_order().with_effects([value("parameter_split", "c", 0.1, term="w")])
    with pytest.raises(InputError, match="unknown parameter 'q'"):
        second_order().with_effects([value("common_factor", "k+q", 0.1)])
    with pytest.raises(InputError, match="'creep' is missing"):
        second_order().with_effects([value("dry_friction", "v", 0.1)])


@pytest.mark.parametrize("kind", ["sensor_bias", "sensor_scale", "sensor_delay", "sensor_lag"])
@pytest.mark.parametrize("name", ["q", "alpha", "V", "theta"])
def test_a_reading_of_any_model_may_have_the_name_of_an_aircraft(kind: str, name: str) -> None:
    """A joint may be called q, and has no qdot beside it. Truth: the same fault under another name."""

    def read(called: str) -> np.ndarray:
        model = cs.define_model(
            "lag",
            states=["x"],
            inputs=["u"],
            parameters={"T": 1.0},
            outputs=[called],
            dynamics=lambda s: {"x": (s.u - s.x) / s.T},
            output=lambda s: {called: s.x},
        ).with_effects([value(kind, called, 0.2)])
        return cs.simulate(model, pushed("m1"), np.zeros(len(model.states))).output(called)

    assert np.array_equal(read(name), read("y"))


def test_what_a_model_does_not_have_is_said() -> None:
    model = second_order()
    with pytest.raises(InputError, match="unknown input 'w'.*: u"):
        model.with_effects([value("actuator_lag", "w", 0.1)])
    with pytest.raises(InputError, match="of the equations of an aircraft"):
        model.with_effects([value("mass", "", 3.0)])
    with pytest.raises(InputError, match="stands twice"):
        model.with_effects([value("sensor_bias", "x", 0.1), value("sensor_bias", "x", 0.2)])
    late = model.with_effects([value("sensor_delay", "x", 0.1)])
    record = cs.simulate(late, pushed("m1"), [0.0, 0.0]).as_record()
    with pytest.raises(EstimationError, match="cannot act in the equations"):
        cs.Problem(late, [record.with_channels(xdot=record["v"])], free=["k"], cost=cs.EquationError())


def test_two_of_one_kind_are_told_apart_by_their_records() -> None:
    both = [value("sensor_bias", "x", 0.1, records=("m1",)), value("sensor_bias", "x", -0.2, records=("m2",))]
    model = second_order().with_effects(both)
    assert set(model.parameters) >= {"sensor_bias(x)[m1]", "sensor_bias(x)[m2]"}
    records = [cs.simulate(model, pushed(name), [0.0, 0.0]).as_record() for name in ("m1", "m2")]
    found = second_order().with_effects([replace(one, value=0.0) for one in both])
    fit = cs.solve(cs.Problem(found, records, free=["sensor_bias*"], noise={"x": 0.01, "v": 0.01}))
    assert fit.values["sensor_bias(x)[m1]"] == pytest.approx(0.1, abs=1e-6)
    assert fit.values["sensor_bias(x)[m2]"] == pytest.approx(-0.2, abs=1e-6)
