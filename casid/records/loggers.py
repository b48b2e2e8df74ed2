"""Translate the columns of programs whose names are their own and always mean the same.

Names without units, as `split_header` leaves them. A channel has one column, or several of which a file has one; signs
turn a program's sense into that of casid. A user's map has priority.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from casid.records.column_map import ColumnMap


@dataclass(frozen=True, kw_only=True)
class Logger:
    """A program that writes text."""

    name: str  # for messages
    signs: tuple[str, ...]  # columns by which it is known: a file of it has all of them
    # channel -> column of a map, or several of which the first one there counts
    columns: Mapping[str, str | tuple[str, ...]]


LOGGERS = (
    Logger(
        name="X-Plane (Data.txt)",
        signs=("Vtrue,_ktas", "alpha,__deg", "pitch,__deg"),
        columns={
            "t": ("_totl,_time:s", "missn,_time:s", "_real,_time:s"),
            "V": "Vtrue,_ktas:kt",
            "alpha": "alpha,__deg:deg",
            "beta": "_beta,__deg:deg",
            "p": "____P,rad/s:rad/s",
            "q": "____Q,rad/s:rad/s",
            "r": "____R,rad/s:rad/s",
            "phi": "_roll,__deg:deg",
            "theta": "pitch,__deg:deg",
            "psi": "hding,_true:deg",
            "az": "Gload,norml:g*-1",
            "altitude": "__alt,ftmsl:ft",
        },
    ),
    Logger(
        name="RealFlight",
        signs=("m-airspeed-MPS",),
        columns={
            "t": "m-currentPhysicsTime-SEC:s",
            "V": "m-airspeed-MPS:m/s",
            "p": "m-rollRate-DEGpSEC:deg/s",
            "q": "m-pitchRate-DEGpSEC:deg/s",
            "r": "m-yawRate-DEGpSEC:deg/s",
            "phi": "m-roll-DEG:deg",
            "theta": "m-inclination-DEG:deg",
            "psi": "m-azimuth-DEG:deg",
            "ax": "m-accelerationBodyAX-MPS2:m/s2",
            "ay": "m-accelerationBodyAY-MPS2:m/s2",
            "az": "m-accelerationBodyAZ-MPS2:m/s2",
            "altitude": "m-altitudeASL-MTR:m",
            "battery": "m-batteryVoltage-VOLTS:V",
        },
    ),
    Logger(
        name="JSBSim",
        signs=("Time", "V_{Total}", "Alpha"),
        columns={
            "t": "Time:s",
            "V": "V_{Total}:ft/s",
            "alpha": "Alpha:deg",
            "beta": "Beta:deg",
            "p": "P:deg/s",
            "q": "Q:deg/s",
            "r": "R:deg/s",
            "pdot": "P dot:deg/s2",
            "qdot": "Q dot:deg/s2",
            "rdot": "R dot:deg/s2",
            "phi": "Phi:deg",
            "theta": "Theta:deg",
            "psi": "Psi:deg",
            "delta_e": "Elevator Position:deg",
            "delta_a": "Left Aileron Position:deg",
            "delta_r": "Rudder Position:deg",
            "altitude": "Altitude ASL:ft",
            "rho": "Rho:slug/ft3",
            "v_north": "V_{North}:ft/s",
            "v_east": "V_{East}:ft/s",
            "v_down": "V_{Down}:ft/s",
        },
    ),
    Logger(
        name="JSBSim (properties)",
        signs=("Time", "/fdm/jsbsim/velocities/vt-fps"),
        columns={
            "t": "Time:s",
            "V": "/fdm/jsbsim/velocities/vt-fps:ft/s",
            "alpha": "/fdm/jsbsim/aero/alpha-rad:rad",
            "beta": "/fdm/jsbsim/aero/beta-rad:rad",
            "p": "/fdm/jsbsim/velocities/p-rad_sec:rad/s",
            "q": "/fdm/jsbsim/velocities/q-rad_sec:rad/s",
            "r": "/fdm/jsbsim/velocities/r-rad_sec:rad/s",
            "phi": "/fdm/jsbsim/attitude/phi-rad:rad",
            "theta": "/fdm/jsbsim/attitude/theta-rad:rad",
            "psi": "/fdm/jsbsim/attitude/psi-rad:rad",
            "delta_e": "/fdm/jsbsim/fcs/elevator-pos-rad:rad",
            "delta_a": "/fdm/jsbsim/fcs/left-aileron-pos-rad:rad",
            "delta_r": "/fdm/jsbsim/fcs/rudder-pos-rad:rad",
            "thrust": "/fdm/jsbsim/propulsion/engine/thrust-lbs:lbf",
            "altitude": "/fdm/jsbsim/position/h-sl-ft:ft",
            "rho": "/fdm/jsbsim/atmosphere/rho-slugs_ft3:slug/ft3",
        },
    ),
    Logger(
        name="FlightGear",
        signs=("/orientation/roll-deg", "/orientation/pitch-deg"),
        columns={
            "t": ("Time:s", "/sim/time/elapsed-sec:s"),
            "V": "/velocities/true-airspeed-kt:kt",
            "alpha": "/orientation/alpha-deg:deg",
            "beta": ("/orientation/side-slip-deg:deg", "/orientation/beta-deg:deg"),
            "p": "/orientation/p-body:rad/s",
            "q": "/orientation/q-body:rad/s",
            "r": "/orientation/r-body:rad/s",
            "phi": "/orientation/roll-deg:deg",
            "theta": "/orientation/pitch-deg:deg",
            "psi": "/orientation/heading-deg:deg",
            "ax": "/accelerations/pilot/x-accel-fps_sec:ft/s2",
            "ay": "/accelerations/pilot/y-accel-fps_sec:ft/s2",
            "az": "/accelerations/pilot/z-accel-fps_sec:ft/s2",
            "altitude": "/position/altitude-ft:ft",
            "delta_e_command": ("/surface-positions/elevator-pos-norm:1*-1", "/controls/flight/elevator:1*-1"),
            "delta_a_command": ("/surface-positions/left-aileron-pos-norm", "/controls/flight/aileron"),
            "delta_r_command": ("/surface-positions/rudder-pos-norm", "/controls/flight/rudder"),
        },
    ),
    Logger(
        name="Garmin G1000",
        signs=("Lcl Time", "AltMSL", "IAS"),
        columns={
            "t": "Lcl Time",
            "V": "TAS:kt",
            "phi": "Roll:deg",
            "theta": "Pitch:deg",
            "psi": "HDG:deg",
            "altitude": ("AltB:ft", "AltMSL:ft"),
        },
    ),
    Logger(
        name="Airdata (DJI)",
        signs=("time", "datetime", "latitude", "longitude", "compass_heading"),
        columns={"t": "time:ms", "psi": "compass_heading:deg", "theta": "pitch:deg", "phi": "roll:deg"},
    ),
    Logger(
        name="DatCon (DJI)",
        signs=("offsetTime", "IMU_ATTI(0):roll", "IMU_ATTI(0):pitch"),
        columns={
            "t": "offsetTime:s",
            "phi": ("IMU_ATTI(0):roll:deg",),
            "theta": ("IMU_ATTI(0):pitch:deg",),
            "psi": ("IMU_ATTI(0):yaw:deg",),
            "p": ("IMU_ATTI(0):gyroX:deg/s",),
            "q": ("IMU_ATTI(0):gyroY:deg/s",),
            "r": ("IMU_ATTI(0):gyroZ:deg/s",),
        },
    ),
    Logger(
        name="PX4 (ulog2csv)",
        signs=("timestamp", "timestamp_sample"),
        columns={"t": "timestamp_sample:us"},
    ),
    Logger(
        name="OnSpeed",
        signs=("timeStamp", "Pfwd", "Palt", "IAS"),
        columns={
            "t": "timeStamp:ms",
            "alpha": "DerivedAOA:deg",
            "V": "TAS:kt",
            "theta": "Pitch:deg",
            "phi": "Roll:deg",
            "p": "RollRate:deg/s",
            "q": "PitchRate:deg/s",
            "r": "YawRate:deg/s",
            "altitude": "Palt:ft",
        },
    ),
    Logger(
        name="OpenRocket",  # of its angles and its rates the signs are not those of an aircraft
        signs=("Time", "Altitude", "Vertical velocity"),
        columns={
            "t": "Time",
            "altitude": ("Altitude above sea level", "Altitude"),
            "v_down": "Vertical velocity*-1",
            "thrust": "Thrust",
            "mach": "Mach number",
        },
    ),
    Logger(
        name="Altus Metrum",
        signs=("serial", "flight", "time", "state", "state_name"),
        columns={
            "t": "time:s",
            "altitude": "altitude:m",
            "p": "gyro_roll:deg/s",
            "q": "gyro_pitch:deg/s",
            "r": "gyro_yaw:deg/s",
            "battery": "battery_voltage:V",
        },
    ),
    Logger(
        name="Betaflight (blackbox_decode)",
        signs=("loopIteration", "time", "gyroADC[0]"),
        columns={
            "t": "time:us",
            "p": "gyroADC[0]:deg/s",
            "q": "gyroADC[1]:deg/s*-1",
            "r": "gyroADC[2]:deg/s*-1",
            "battery": ("vbatLatest:V",),
            **{f"m{i + 1}": f"motor[{i}]" for i in range(8)},
        },
    ),
)


def logger_of(names: Collection[str]) -> tuple[str, ColumnMap] | None:
    """Name of the program that wrote columns of these names, and the map of those that it has; None for another."""
    there = set(names)
    for logger in LOGGERS:
        if not there.issuperset(logger.signs):
            continue
        columns = {}
        for channel, several in logger.columns.items():
            for column in (several,) if isinstance(several, str) else several:
                one = ColumnMap.of({channel: column}).columns
                if one[channel][0].column in there:
                    columns |= one
                    break
        return logger.name, ColumnMap(columns=columns)
    return None
