"""The HFB-320 as an aircraft file, so that the diagnosis can look at the record of `hfb320` without its special model.

Mass properties and lengths follow from the published model's constants (see `hfb320`). What the aircraft file cannot
say, the 3 deg inclination of the thrust, changes lift by less than one per cent of the weight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casid.model.aircraft import Aircraft, Inertia
from casid.records.record import Record
from problems.real.hfb320 import PUBLISHED

MASS, AREA, CHORD, RHO = 7472.0, 4.028e-3 * 7472.0, 2.43, 0.792  # kg, m2, m, kg/m3
IYY = AREA * CHORD / 8.0027e-4  # kg m2
_LATERAL = ("delta_a", "delta_r")


def aircraft(derivatives: Mapping[str, float] = PUBLISHED) -> Aircraft:
    """Longitudinal derivatives; Ixx and Izz only have to be possible ones, nothing rolls or yaws in this model."""
    return Aircraft(
        name="HFB-320",
        mass=MASS,
        inertia=Inertia(Ixx=0.5 * IYY, Iyy=IYY, Izz=1.4 * IYY, Ixz=0.0),
        gravity=9.80665,
        area=AREA,
        moment_length_lateral=14.49,
        moment_length_pitch=CHORD,
        rate_length_lateral=7.245,
        rate_length_pitch=CHORD / 2.0,
        thrust_line_z=-7.0153e-6 * IYY,
        trim={"V": 104.67, "rho": RHO},
        derivatives=dict(derivatives),
    )


def longitudinal(record: Record) -> Record:
    """The record with constant density and without lateral surfaces, so that the longitudinal model is taken."""
    return record.without(*_LATERAL).with_channels(rho=np.full(len(record), RHO))
