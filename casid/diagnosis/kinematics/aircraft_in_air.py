"""Does air that shows in vanes and airspeed move the aircraft, too? Slow noise of these instruments does not.

With forces free, kinematics know moving air by three readings alone, and slow noise of any of them looks like it but
for its spectrum. By its aerodynamics the aircraft answers to air that moves, in forces, rates and attitude. So both
compete in the full model: noise of all readings as slow as it comes, in calm air and in moving air.
"""

from __future__ import annotations

from casid.diagnosis.flight.colour import as_slow_as_left
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.kinematics.kinematics import Turbulence, gusts


def moves_the_aircraft(turbulent: Turbulence, refitted: FlightFit) -> bool:
    """Whether moving air explains more than slow noise of all readings, as much as it must gain of kinematics, by the
    file `refitted` in calm air. Air of the same strength and scale as in kinematics; it rolls the aircraft, too."""
    flight = refitted.flight
    if refitted.noise.colour:  # noise as the fit leaves it: its level has taken in whatever the air does
        return True
    air = gusts(flight, turbulent.sigma, {"dCl": 1.0}, turbulent.length)
    moving = fit(flight, refitted.attached, flight.noise(air), refitted, tolerance=2.0)
    gain = as_slow_as_left(refitted).deviance - as_slow_as_left(moving).deviance
    return gain > turbulent.criteria.gain
