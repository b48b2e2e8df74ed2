"""The causes: every way in which reality may differ from the aircraft file, each defined once, by where it enters."""

from casid.model.causes.aerodynamics import aero_term, configuration_change, missing_derivative, unsteady_aero
from casid.model.causes.air import gust, turbulence, wind_shear
from casid.model.causes.controls import (
    actuator_lag,
    backlash,
    dead_zone,
    effectiveness_change,
    feedback,
    input_delay,
    input_limit,
    input_offset,
    input_scale,
    rate_limit,
    sample_hold,
    second_order_actuator,
    stuck,
)
from casid.model.causes.equations import (
    common_factor,
    cross_damping,
    damping,
    dry_friction,
    inertia_scale,
    missing_term,
    parameter_change,
    parameter_split,
    relaxation,
)
from casid.model.causes.instruments import (
    SENSOR_GROUPS,
    accelerometer_position,
    group_channels,
    sensor_bias,
    sensor_delay,
    sensor_lag,
    sensor_scale,
    sensor_stuck,
    structural_mode,
    vane_position,
)
from casid.model.causes.loading import cg_offset, inertia, mass, moment_reference, thrust_asymmetry, thrust_line
from casid.model.causes.recording import clock_drift, position_error, sensor_misalignment, thrust_scale
from casid.model.causes.rotors import (
    added_mass,
    battery_sag,
    body_drag,
    mass_change,
    rotor_delay,
    rotor_effectiveness,
    rotor_inflow,
    rotor_lag,
    rotor_limit,
    rotor_position,
    rotor_rise_fall,
    rotor_swap,
    rotor_tilt,
    rotor_torque,
    thrust_curve,
)
from casid.model.causes.tables import table_increment
from casid.model.effect import KINDS
