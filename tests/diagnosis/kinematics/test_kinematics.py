"""Kinematics judge a lever arm by the angular acceleration that they find themselves, from noisy rates."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import kinematics
from casid.model.airframe import Inertia
from casid.model.causes.instruments import accelerometer_position, sensor_bias, sensor_delay, sensor_lag, sensor_scale
from casid.model.effect import Effect
from problems.do328 import STABLE, do328

_LEVER = 2.0  # m
_NOISY = {name: 4.0 * s if name in "pqr" else s for name, s in NOISE.items()}


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_lever_arm_is_not_underestimated_by_the_noise_of_the_rates(
    axis: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truth: 2 m. With angular accelerations far freer than they are, their noise makes it less than 80 % of that."""
    hidden = Attached(effect=accelerometer_position(axis), values={"value": _LEVER})
    flight = prepare(do328(), flights([hidden], seed=5, count=2, noise=_NOISY))

    def found() -> tuple[float, float]:
        start = [hidden.with_values({"value": 0.0})]
        fitted = kinematics.reconstruct(flight, start)
        fitted = fit(fitted.flight, start, fitted.noise, fitted, free="effects", extent=(15, 0.1))
        return fitted[hidden.name], fitted.std(hidden.name)

    value, std = found()
    assert abs(value - _LEVER) < 3.0 * std
    assert std < 0.2 * _LEVER
    monkeypatch.setattr(kinematics, "_angular_acceleration", lambda *_: 20.0)
    assert found()[0] < 0.8 * _LEVER


@pytest.mark.parametrize("late", [sensor_delay("p"), sensor_delay("q"), sensor_lag("p"), sensor_lag("q")])
def test_the_fit_of_a_late_rate_ends_converged(late: Effect) -> None:
    """Truth: 0.06 s. Its series is made of the motion before a step, so that a step which promises nothing more may
    raise the sum of squares; shorter ones do so too, and were all tried."""
    hidden = Attached(effect=late, values={"value": 0.06})
    flight = prepare(do328(), flights([hidden], seed=3, count=2, duration_s=12.0))
    found = kinematics.again(kinematics.reconstruct(flight), [hidden.with_values({"value": 0.1})])
    assert found.converged and found[late.name] == pytest.approx(0.06, rel=0.04)


def test_a_free_angular_acceleration_is_as_large_as_the_true_one() -> None:
    """Truth: the derivative of a noiseless rate, its root mean square, within the factor for peaks."""
    quiet = {name: 1e-3 * s if name in "pqr" else s for name, s in NOISE.items()}
    record = flights(seed=6, count=1, noise=quiet)
    true = float(np.std(np.gradient(record[0]["p"], record[0].t)))
    for noise in (quiet, _NOISY):
        flight = prepare(do328(), flights(seed=6, count=1, noise=noise))
        assert kinematics._angular_acceleration(flight, "p", flight.criteria.kinematics) == pytest.approx(
            2.0 * true, rel=0.3
        )


def test_free_forces_do_not_depend_on_the_order_of_the_records() -> None:
    """Truth: symmetry. One of two records is at half the density of the other."""
    low, high = flights(seed=6, count=2)
    high = high.with_channels(rho=0.5 * high["rho"])
    one, other = (kinematics.free_forces(prepare(do328(), order)) for order in ([low, high], [high, low]))
    for place, process in one.items():
        assert process == pytest.approx(other[place], rel=1e-9)


def test_kinematics_do_not_depend_on_the_aerodynamics_of_the_file() -> None:
    """Truth: a bias of the pitch rate. A file with other damping, and a moment that the aircraft does not have, says
    of it what the right file says."""
    hidden = Attached(effect=sensor_bias("q"), values={"value": 0.004})
    flown = flights([hidden], seed=5, count=1)
    wrong = {name: 0.3 * value for name, value in STABLE.items()} | {"Cm_0": 0.2, "CL_0": 0.0}
    fits = [
        kinematics.reconstruct(prepare(do328(values), flown), [hidden.with_values({"value": 0.0})])
        for values in (STABLE, wrong)
    ]
    assert fits[1].deviance == pytest.approx(fits[0].deviance, abs=1e-6 * fits[0].readings)
    assert fits[1][hidden.name] == pytest.approx(fits[0][hidden.name], abs=1e-9)
    assert abs(fits[0][hidden.name] - 0.004) < 3.0 * fits[0].std(hidden.name)


def test_without_aerodynamics_an_aircraft_flies_as_it_was_recorded_on_average() -> None:
    """Truth: the mean specific forces of the record."""
    flight = prepare(do328(), flights(seed=6, count=2))
    bare = kinematics.without_aerodynamics(flight)
    assert kinematics.without_aerodynamics(flight) is bare
    model, batch = bare.model(), bare.batch(bare.model())
    functions = bare.functions(model)
    parameters = np.tile(model.nominal_vector(), (len(bare.records), 1))
    disturbances = np.zeros((*batch.live.shape, len(model.disturbances)))
    read = functions.output(bare.measured(model), batch.U, parameters, disturbances)
    for channel, tolerance in (("ax", 0.05), ("ay", 0.05), ("az", 0.3)):
        i = model.outputs.index(channel)
        assert np.mean(read[..., i][batch.live]) == pytest.approx(
            np.mean(batch.Z[..., i][batch.live]), abs=tolerance
        ), channel


def test_a_scale_of_the_airspeed_is_found_whatever_the_size_of_free_moments() -> None:
    """Truth: 6 % in a flight of the model. Nothing is known of moments, so their size says nothing of the airspeed."""
    hidden = Attached(effect=sensor_scale("V"), values={"value": 0.06})
    flown, found = flights([hidden], seed=11, count=2), []
    for peak in (0.5, 2.0, 8.0):
        criteria = replace(Criteria(), parts=replace(Criteria().parts, half=1.0 / peak))
        fit = kinematics.reconstruct(prepare(do328(), flown, criteria), [hidden.with_values({"value": 0.0})])
        found.append(fit[hidden.name])
        assert abs(found[-1] - 0.06) < 3.0 * fit.std(hidden.name)
    assert np.ptp(found) < 0.2 * fit.std(hidden.name)


def test_kinematics_do_not_depend_on_mass_inertia_or_thrust() -> None:
    """Truth: symmetry. Rates, accelerations, attitudes and air data of a flight are the same for every aircraft."""
    plane, flown = do328(), flights(seed=5, count=1)
    other = replace(plane, mass=3.0 * plane.mass, inertia=Inertia(Ixx=1e5, Iyy=3e5, Izz=2e5, Ixz=2e4), area=5.0)
    pushed = [record.with_channels(thrust=0.3 * record["thrust"]) for record in flown]
    known, unknown = (
        kinematics.reconstruct(prepare(file, records)) for file, records in ((plane, flown), (other, pushed))
    )
    assert unknown.deviance == pytest.approx(known.deviance, abs=1e-6 * known.readings)
