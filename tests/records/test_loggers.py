"""Heads of files as loggers and programs in the field write them, written here by what is public of the formats.

Truth: the three samples that every head holds, alpha 1.5, 1.6, 1.7 deg and q 2, 3, 4 deg/s at 0, 20 and 40 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from casid.records.clock import from_first
from casid.records.column_map import ColumnMap
from casid.records.columns import channels_of
from casid.records.table import read_text

T = (0.0, 0.02, 0.04)
ALPHA, Q = (1.5, 1.6, 1.7), (2.0, 3.0, 4.0)
SECONDS = ("0.00", "0.02", "0.04")
CLOCK = ("09:14:22.020", "09:14:22.040", "09:14:22.060")


@dataclass(frozen=True, kw_only=True)
class Head:
    """Lines above the rows, a template of a row with {t}, {a}, {q}, the stamps, and what a user must say in a map."""

    above: str
    row: str = "{t},{a},{q}"
    stamps: tuple[str, ...] = SECONDS
    options: tuple[str, ...] = ()
    columns: tuple[tuple[str, list[str]], ...] = ()
    ending: str = "csv"
    encoding: str = "utf-8"
    below: str = ""
    comma: bool = False

    @property
    def text(self) -> bytes:
        rows = [
            self.row.format(i=i, t=t, a=self._number(a), q=self._number(q))
            for i, (t, a, q) in enumerate(zip(self.stamps, ALPHA, Q, strict=True))
        ]
        return ("\n".join([*([self.above] if self.above else []), *rows]) + "\n" + self.below).encode(self.encoding)

    def _number(self, value: float) -> str:
        return f"{value:.4f}".replace(".", ",") if self.comma else f"{value:.4f}"


AQ = ("alpha=Alpha", "q=Q")
DEG = ("alpha=Alpha:deg", "q=Q:deg/s")
PITCH = ("alpha=Pitch", "q=PitchRate:deg/s")
HEADS = {
    "casid": Head(above="t,alpha [deg],q [deg/s]"),
    "suffixes": Head(above="TIME_s,alpha_deg,q_deg_s"),
    "upper-case units": Head(above="Time (SEC),alpha (DEG),q (DEG/SEC)"),
    "DEWESoft": Head(
        above="Exported by DEWESoft\nFile name: flight.dxd\nStart time: 5/3/2024 9:14:22 AM\nSample rate: 50 Hz\n\n"
        "Time (s)\tAlpha (deg)\tQ (deg/s)",
        row="{t}\t{a}\t{q}",
        options=AQ,
        ending="txt",
    ),
    "Dewetron": Head(
        above="Time;Alpha;Q\ns;deg;deg/s", row="{t};{a};{q}", options=AQ, comma=True, stamps=("0,00", "0,02", "0,04")
    ),
    "NI LabVIEW measurement": Head(
        above="LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tAbsolute\nDate\t2024/05/03\nTime\t09:14:22.020\n"
        "***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t3\t3\t\nDate\t2024/05/03\t2024/05/03\t\n"
        "Time\t09:14:22.02\t09:14:22.02\t\nX_Dimension\tTime\tTime\t\nX0\t0.0E+0\t0.0E+0\t\n"
        "Delta_X\t0.02\t0.02\t\n***End_of_Header***\t\t\t\nX_Value\tAlpha\tQ\tComment",
        row="{t}\t{a}\t{q}",
        options=DEG,
        ending="txt",
    ),
    "NI DIAdem": Head(
        above="Time\tAlpha\tQ\ns\tdeg\tdeg/s",
        row="{t}\t{a}\t{q}",
        stamps=tuple(f"03.05.2024 {c}" for c in CLOCK),
        options=AQ,
        ending="asc",
    ),
    "Vector CANape": Head(above="time[s];Alpha[deg];Q[deg/s]", row="{t};{a};{q}", options=AQ),
    "ACRA": Head(
        above="IRIG Time,ALPHA,QB",
        stamps=tuple(f"124:{c}000" for c in CLOCK),
        options=("alpha=ALPHA:deg", "q=QB:deg/s"),
    ),
    "IADS": Head(
        above="Project: test\nFlight: 12\n\nTime\tALPHA\tQB\nddd:hh:mm:ss\tdeg\tdeg/s",
        row="{t}\t{a}\t{q}",
        stamps=tuple(f"124:{c}" for c in CLOCK),
        options=("alpha=ALPHA", "q=QB"),
        ending="txt",
    ),
    "telemetry, ordinal days": Head(above="UTC,Alpha,Q", stamps=tuple(f"2024-124T{c}Z" for c in CLOCK), options=DEG),
    "Garmin G1000": Head(
        above='#airframe_info, log_version="1.00", airframe_name="C172"\n'
        "#yyy-mm-dd, hh:mm:ss, ident, deg, ft msl, kt, deg, deg/s\n"
        "  Lcl Date, Lcl Time, AtvWpt, Latitude, AltMSL, IAS, Pitch, Extra",
        row="2024-05-03, {t},     , 51.4, 1200.0, 90.0, {a}, {q}",
        stamps=CLOCK,
        options=("alpha=Pitch", "q=Extra"),
    ),
    "Dynon SkyView": Head(
        above="Session Time,GPS Fix Quality,Pitch (deg),Roll (deg),True Airspeed (knots),Pitch Rate (deg/s)",
        row="{t},2,{a},0.0,90.0,{q}",
        options=("alpha=Pitch", "q=Pitch Rate", "V=True Airspeed"),
    ),
    "Airdata of DJI": Head(
        above="time(millisecond),datetime(utc),latitude,longitude,speed(mph),compass_heading(degrees),pitch(degrees),extra",
        row="{t},2024-05-03 09:14:22,51.4,-0.6,20.0,10.0,{a},{q}",
        stamps=("0", "20", "40"),
        options=("alpha=pitch", "q=extra:deg/s"),
    ),
    "DatCon of DJI": Head(
        above="Tick#,offsetTime,IMU_ATTI(0):roll,IMU_ATTI(0):pitch,IMU_ATTI(0):gyroY,Motor:Status",
        row="100,{t},0.0,{a},{q},ON",
        options=("alpha=IMU_ATTI(0):pitch:deg",),
    ),
    "X-Plane": Head(
        above="\n  missn,_time |  Vtrue,_ktas |  pitch,__deg |  alpha,__deg |  ____Q,rad/s | ",
        row="{t} | 90.0 | 2.0 | {a} | {q} | ",
        columns=(("q", ["____Q,rad/s:deg/s"]),),
        ending="txt",
    ),
    "RealFlight": Head(
        above="m-currentPhysicsTime-SEC,m-airspeed-MPS,m-pitchRate-DEGpSEC,m-inclination-DEG",
        row="{t},20.0,{q},{a}",
        options=("alpha=m-inclination-DEG:deg",),
    ),
    "JSBSim": Head(above="Time,V_{Total} (ft/s),Alpha (deg),Q (deg/s)", row="{t},300.0,{a},{q}"),
    "JSBSim properties": Head(
        above="Time,/fdm/jsbsim/velocities/vt-fps,/fdm/jsbsim/aero/alpha-rad,/fdm/jsbsim/velocities/q-rad_sec",
        row="{t},300.0,{a},{q}",
        options=("alpha=/fdm/jsbsim/aero/alpha-rad:deg", "q=/fdm/jsbsim/velocities/q-rad_sec:deg/s"),
    ),
    "FlightGear": Head(
        above="Time,/orientation/roll-deg,/orientation/pitch-deg,/orientation/alpha-deg,/orientation/q-body",
        row="{t},0.0,2.0,{a},{q}",
        options=("q=/orientation/q-body:deg/s",),
    ),
    "PX4 ulog2csv": Head(
        above="timestamp,timestamp_sample,xyz[0],xyz[1]",
        row="1{t},1{t},{a},{q}",
        stamps=("000000", "020000", "040000"),
        options=("alpha=xyz[0]:deg", "q=xyz[1]:deg/s"),
    ),
    "PlotJuggler": Head(
        above="__time,/attitude/pitch,/rates/q",
        stamps=("1714727662.02", "1714727662.04", "1714727662.06"),
        options=("alpha=/attitude/pitch:deg", "q=/rates/q:deg/s"),
    ),
    "ArduPilot mavlogdump": Head(
        above="timestamp,TimeUS,Pitch,PitchRate",
        row="{t},57838522,{a},{q}",
        stamps=("1714727662.02", "1714727662.04", "1714727662.06"),
        options=("alpha=Pitch:deg", "q=PitchRate:deg/s"),
    ),
    "QGroundControl": Head(
        above="Timestamp,pitch,pitchRate",
        stamps=tuple(f"2024-05-03 {c}" for c in CLOCK),
        options=("alpha=pitch:deg", "q=pitchRate:deg/s"),
    ),
    "Betaflight blackbox_decode": Head(
        above="loopIteration, time (us), gyroADC[0], gyroADC[1], motor[0]",
        row="0, {t}, {a}, -{q}, 1200",
        stamps=("5000000", "5020000", "5040000"),
        options=("alpha=gyroADC[0]:deg",),
    ),
    "OnSpeed": Head(
        above="timeStamp,Pfwd,Palt,IAS,DerivedAOA,PitchRate",
        row="{t},900,1200,90,{a},{q}",
        stamps=("7000", "7020", "7040"),
    ),
    "MoTeC": Head(
        above='"Format","MoTeC CSV File",,,\n"Vehicle","trainer",,,\n"Log Date","03/05/2024",,,\n\n"Time","Alpha","Q"\n'
        '"s","deg","deg/s"\n',
        row='"{t}","{a}","{q}"',
        options=AQ,
    ),
    "numpy savetxt": Head(
        above="# t alpha q", row="{t} {a} {q}", options=("alpha=alpha:deg", "q=q:deg/s"), ending="txt"
    ),
    "pandas": Head(above=",t,alpha_deg,q_dps", row="{i},{t},{a},{q}"),
    "Excel in German": Head(
        above="sep=;\nZeit;Alpha [°];Q [°/s]",
        row="{t};{a};{q}",
        stamps=tuple(f"03.05.2024 {c.replace('.', ',')}" for c in CLOCK),
        options=AQ,
        comma=True,
        encoding="cp1252",
    ),
    "Excel, Unicode text": Head(
        above="Time\tAlpha [°]\tQ [°/s]", row="{t}\t{a}\t{q}", options=AQ, encoding="utf-16", ending="txt"
    ),
    "OptiTrack": Head(
        above="Format Version,1.23,Take Name,Take 1\n\n,Type,Rigid Body,Rigid Body\n"
        ",Name,plane,plane\n,,Rotation,Rotation\n"
        "Frame,Time (Seconds),Y,X",
        row="{i},{t},{a},{q}",
        options=("alpha=Y:deg", "q=X:deg/s"),
    ),
    "ROS topic": Head(
        above="%time,field.seq,field.pitch,field.angular_velocity.y",
        row="{t},1,{a},{q}",
        stamps=("1714727662020000000", "1714727662040000000", "1714727662060000000"),
        options=("alpha=field.pitch:deg", "q=field.angular_velocity.y:deg/s"),
    ),
    "Xsens": Head(
        above="// Start Time: Unknown\n// Update Rate: 50.0Hz\n// Filter Profile: general\n"
        "PacketCounter\tSampleTimeFine\tGyr_Y\tPitch",
        row="00001\t{t}\t{q}\t{a}",
        stamps=("10000", "10200", "10400"),
        options=("t=1e-4*SampleTimeFine", "alpha=Pitch:deg", "q=Gyr_Y:deg/s"),
        ending="txt",
    ),
    "VectorNav": Head(
        above="TimeStartup,Pitch,GyroY",
        stamps=("5000000000", "5020000000", "5040000000"),
        options=("t=TimeStartup:ns", "alpha=Pitch:deg", "q=GyroY:deg/s"),
    ),
    "NovAtel": Head(
        above="Project: flight\nProgram: Inertial Explorer\n\n  UTCTime   Pitch   YRate\n  (sec)   (deg)   (deg/s)",
        row="  {t}   {a}   {q}",
        options=("alpha=Pitch", "q=YRate"),
        ending="txt",
    ),
    "Crazyflie client": Head(
        above="Timestamp,stabilizer.pitch,gyro.y",
        stamps=("7000", "7020", "7040"),
        options=("t=Timestamp:ms", "alpha=stabilizer.pitch:deg", "q=gyro.y:deg/s"),
    ),
    "US dates with half days": Head(
        above="Time,Alpha,Q",
        stamps=("5/3/2024 11:59:59.990 AM", "5/3/2024 12:00:00.010 PM", "5/3/2024 12:00:00.030 PM"),
        options=DEG,
    ),
    "over midnight": Head(above="UTC Time,Alpha,Q", stamps=("23:59:59.99", "00:00:00.01", "00:00:00.03"), options=DEG),
    "epoch in ms": Head(
        above="timestamp,Alpha,Q", stamps=("1714727662020", "1714727662040", "1714727662060"), options=DEG
    ),
    "epoch in us": Head(
        above="timestamp,Alpha,Q", stamps=("1714727662020000", "1714727662040000", "1714727662060000"), options=DEG
    ),
    "cut off in the last row": Head(above="t,alpha [deg],q [deg/s]", below="0.06,1.8"),
    "a separator behind each row": Head(above="t,alpha [deg],q [deg/s]", row="{t},{a},{q},"),
    "a byte order mark and Windows": Head(above="\ufefft,alpha [deg],q [deg/s]\r", row="{t},{a},{q}\r"),
    "numbers without names": Head(
        above="HSVA experiment\nZ20°/5°\nTime series",
        row=" {t} {a} {q}",
        options=("t=1", "alpha=2:deg", "q=3:deg/s"),
        ending="dat",
        encoding="latin-1",
    ),
    "rows at a steady rate": Head(above="Alpha,Q", row="{a},{q}", options=("t=row*0.02", *DEG)),
}


def test_there_are_forty_of_them() -> None:
    assert len(HEADS) >= 40


@pytest.mark.parametrize("name", HEADS)
def test_a_head_is_read(name: str, tmp_path) -> None:
    head = HEADS[name]
    path = tmp_path / f"m.{head.ending}"
    path.write_bytes(head.text)
    found = channels_of(read_text(path), ColumnMap.from_options(head.options).merged(ColumnMap.of(dict(head.columns))))
    t, _ = from_first(found.channels["t"], "t" in found.stated)
    np.testing.assert_allclose(t - t[0], T, atol=1e-6)
    np.testing.assert_allclose(found.channels["alpha"], np.radians(ALPHA), rtol=1e-9)
    np.testing.assert_allclose(found.channels["q"], np.radians(Q), rtol=1e-9)
