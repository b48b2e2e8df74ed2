"""Tables in files of other programs: MATLAB, numpy, HDF5, Parquet, Excel, MDF4, PX4 ULog."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError, unknown
from casid.records.checks import INPUTS
from casid.records.clock import seconds_of
from casid.records.table import RawTable
from casid.signals import CHANNELS


def loaded(path: Path, load: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `load` returns; whatever it raises becomes an InputError."""
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        return load()
    except NotImplementedError:
        raise
    except Exception as error:  # a damaged file makes these libraries raise some twenty unrelated types
        fault = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: not a readable {path.suffix} file: {fault[:120]}") from None


def table_of(path: Path, arrays: Mapping[str, Any], variable: str | None, time: str) -> RawTable:
    """The table of named arrays: its one matrix, or one vector per channel; fields of structs count as arrays."""
    arrays = dict(_fields(arrays))
    numeric = {k: v for k, v in arrays.items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiub" and v.size > 1}
    if variable is not None:
        if variable not in numeric:
            raise unknown("variable", variable, numeric, str(path))
        numeric = {variable: numeric[variable]}
    vectors = {name: v.ravel() for name, v in numeric.items() if max(v.shape) == v.size}
    matrices = {name: v for name, v in numeric.items() if v.ndim == 2 and name not in vectors}
    if vectors and (time in vectors or not matrices):
        return _vectors(path, vectors, time)
    if len(matrices) != 1:
        held = ", ".join(matrices) or "none"
        raise InputError(
            f"{path}: expected one matrix, or one vector per channel with '{time}' among them; matrices in the file: "
            f"{held}; name one as 'variable' in a column map"
        )
    name, matrix = next(iter(matrices.items()))
    if matrix.shape[0] < matrix.shape[1]:
        raise InputError(f"{path}: '{name}' has shape {matrix.shape}; expected samples in rows: transpose it")
    return RawTable(source=str(path), names=None, values=matrix.astype(float))


def _fields(arrays: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Arrays by name, structs of MATLAB taken apart."""
    for name, value in arrays.items():
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            yield from _fields({field: value.reshape(-1)[0][field] for field in value.dtype.names})
        else:
            yield name, value


def _vectors(path: Path, vectors: Mapping[str, np.ndarray], time: str) -> RawTable:
    reference = time if time in vectors else next(iter(vectors))
    for name, values in vectors.items():
        if len(values) != len(vectors[reference]):
            raise InputError(
                f"{path}: variable '{name}' has {len(values)} samples, '{reference}' has {len(vectors[reference])}; "
                "all channels need the same"
            )
    values = np.stack([v.astype(float) for v in vectors.values()], axis=1)
    return RawTable(source=str(path), names=tuple(vectors), values=values)


# Channel -> (topic, field, factor) of a PX4 fixed wing; the attitude is a quaternion of its own topic.
PX4 = {
    "p": ("vehicle_angular_velocity", "xyz[0]", 1.0),
    "q": ("vehicle_angular_velocity", "xyz[1]", 1.0),
    "r": ("vehicle_angular_velocity", "xyz[2]", 1.0),
    "pdot": ("vehicle_angular_velocity", "xyz_derivative[0]", 1.0),
    "qdot": ("vehicle_angular_velocity", "xyz_derivative[1]", 1.0),
    "rdot": ("vehicle_angular_velocity", "xyz_derivative[2]", 1.0),
    "ax": ("vehicle_acceleration", "xyz[0]", 1.0),
    "ay": ("vehicle_acceleration", "xyz[1]", 1.0),
    "az": ("vehicle_acceleration", "xyz[2]", 1.0),
    "V": ("airspeed_validated", "true_airspeed_m_s", 1.0),
    "altitude": ("vehicle_air_data", "baro_alt_meter", 1.0),
    "rho": ("vehicle_air_data", "rho", 1.0),
    "delta_a_command": ("vehicle_torque_setpoint", "xyz[0]", 1.0),
    "delta_e_command": ("vehicle_torque_setpoint", "xyz[1]", 1.0),
    "delta_r_command": ("vehicle_torque_setpoint", "xyz[2]", 1.0),
    "throttle": ("vehicle_thrust_setpoint", "xyz[0]", 1.0),
}
Series = tuple[np.ndarray, np.ndarray]  # stamps [s] and values

# PX4 logs of recent and older versions name the wind differently.
_WIND = ("wind", "wind_estimate")
_GROUND = {"v_north": "vx", "v_east": "vy", "v_down": "vz", "north": "x", "east": "y"}
_ATTITUDE = ("vehicle_attitude", tuple(f"q[{i}]" for i in range(4)))
_MEASURED = frozenset(CHANNELS) - frozenset(INPUTS) - {"t", "throttle"}
_SAME_RATE = 0.9  # of the clock's samples, from which a channel has its rate
_GAP = 5.0  # median steps of a topic: a longer pause stays a gap


def read_hdf5(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an HDF5 file or a MATLAB 7.3 one: one vector per channel, or one matrix; needs the extra `hdf5`."""
    h5py = library("h5py", path, "hdf5")

    def load() -> dict[str, Any]:
        found: dict[str, Any] = {}

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not name.startswith("#"):
                found[name.rsplit("/", 1)[-1]] = np.asarray(item)

        with h5py.File(path, "r") as file:
            file.visititems(visit)
            matlab = any("MATLAB_class" in item.attrs for item in file.values())
        # MATLAB writes columns first
        return {k: v.T if matlab and v.ndim == 2 else v for k, v in found.items()}

    return table_of(path, loaded(path, load), variable, time)


def read_excel(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a sheet of an .xlsx file, by default the first; needs the extra `excel`."""
    openpyxl = library("openpyxl", path, "excel")

    def load() -> dict[str, Any]:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            return {sheet.title: list(sheet.iter_rows(values_only=True)) for sheet in book.worksheets}
        finally:
            book.close()

    sheets = loaded(path, load)
    if variable is not None and variable not in sheets:
        raise unknown("sheet", variable, sheets, str(path))
    name, rows = (variable, sheets[variable]) if variable is not None else next(iter(sheets.items()))
    rows = [row for row in rows if any(cell is not None for cell in row)]
    if len(rows) < 2:
        raise InputError(f"{path}: sheet '{name}' is empty; expected a row of channel names and rows of numbers")
    head, *body = rows
    values = np.full((len(body), len(head)), np.nan)
    text: dict[int, tuple[int, str]] = {}
    for i, row in enumerate(body):
        for j, cell in enumerate(row[: len(head)]):
            number = _number(cell)
            if number is None:
                text.setdefault(j, (i, str(cell)))
            else:
                values[i, j] = number
    names = tuple("" if cell is None else str(cell).strip() for cell in head)
    return RawTable(source=str(path), names=names, values=values, text=text)


def read_mdf(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an MDF4 measurement on the clock of its fastest channel; needs the extra `mdf`."""
    asammdf = library("asammdf", path, "mdf")

    def load() -> dict[str, Any]:
        with asammdf.MDF(path) as file:
            signals = [s for s in file.iter_channels(skip_master=True) if s.samples.dtype.kind in "fiub"]
            named = {f"{s.name} [{s.unit}]" if s.unit else s.name: (s.timestamps, s.samples) for s in signals}
        return {"signals": named}

    return joined(path, loaded(path, load)["signals"])


def read_ulog(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a PX4 ULog of a fixed wing, on the clock of its rates; needs the extra `ulog`.

    The attitude is made of its quaternion. Surfaces of PX4 are normalised commands, not angles. They are kept as
    ``delta_e_command`` and so on, and become surfaces by a column map with the throw as weight:
    ``--map delta_e=delta_e_command:deg*25``.
    """
    pyulog = library("pyulog", path, "ulog")

    def load() -> dict[str, Any]:
        topics: dict[str, Any] = {}
        with path.open("rb") as file:
            log = pyulog.ULog(file)
        for topic in log.data_list:
            if topic.multi_id == 0:
                topics.setdefault(topic.name, topic.data)
        return topics

    topics = loaded(path, load)
    series: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for channel, (topic, entry, factor) in PX4.items():
        if topic in topics and entry in topics[topic]:
            series[channel] = (topics[topic]["timestamp"] * 1e-6, factor * np.asarray(topics[topic][entry], float))
    topic, parts = _ATTITUDE
    if topic in topics and all(part in topics[topic] for part in parts):
        stamps = topics[topic]["timestamp"] * 1e-6
        angles = euler_angles(np.stack([np.asarray(topics[topic][part], float) for part in parts], axis=1))
        series |= {name: (stamps, angles[:, i]) for i, name in enumerate(("phi", "theta", "psi"))}
    series |= _of_topic(topics, "vehicle_local_position", _GROUND)
    for topic in _WIND:
        series |= _of_topic(topics, topic, {"wind_north": "windspeed_north", "wind_east": "windspeed_east"})
    if not series:
        held = ", ".join(sorted(topics)[:8])
        raise InputError(f"{path}: none of the topics of a fixed wing is in the log; it holds {held or 'nothing'}")
    return joined(path, series, _lost(series))


def _of_topic(topics: Mapping[str, Any], topic: str, entries: Mapping[str, str]) -> dict[str, Series]:
    """Channels that are fields of one topic."""
    if topic not in topics:
        return {}
    data = topics[topic]
    there = {name: entry for name, entry in entries.items() if entry in data}
    return {name: (data["timestamp"] * 1e-6, np.asarray(data[entry], float)) for name, entry in there.items()}


def _lost(series: Mapping[str, Series]) -> tuple[str, ...]:
    """What a log of PX4 does not measure."""
    notes = ["alpha and beta are not measured: vanes and upwash cannot be judged"]
    notes.append("thrust is not measured, and throttle is no thrust: drag and propulsion cannot be told apart")
    if "phi" in series:
        notes.append("phi, theta and psi are estimates of the autopilot's filter, not measurements of their own")
    if "V" not in series:
        notes.append("there is no airspeed: V is lost, and dynamic pressure with it")
    return tuple(notes)


def euler_angles(quaternion: np.ndarray) -> np.ndarray:
    """(N, 3) 3-2-1 Euler angles phi, theta, psi [rad] of (N, 4) unit quaternions w, x, y, z from body to earth axes."""
    w, x, y, z = quaternion.T
    phi = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    psi = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return np.stack([phi, theta, psi], axis=1)


def joined(path: Path, series: Mapping[str, Series], notes: tuple[str, ...] = ()) -> RawTable:
    """Channels of several rates on the clock of the fastest. Pauses stay gaps.

    Measured outputs of a slower rate keep their own samples, each at the nearest time of the clock, and are missing in
    between: straight lines would be samples that nobody took. What drives a model, and what no model knows, is joined
    by straight lines.
    """
    whole = {name: one for name, one in series.items() if len(one[0]) > 1}
    if not whole:
        raise InputError(f"{path}: no channel has two samples; expected time series")
    clock = max((stamps for stamps, _ in whole.values()), key=len)
    spans = [(stamps[0], stamps[-1]) for name, (stamps, _) in whole.items() if name.endswith("_command")]
    for begin, end in spans:  # what drives a model must be complete
        clock = clock[(clock >= begin) & (clock <= end)]
    if len(clock) < 2:
        raise InputError(f"{path}: the commands of the surfaces have no time in common with the other channels")
    columns = [clock - clock[0]]
    for name, (stamps, values) in whole.items():
        column = np.interp(clock, stamps, np.asarray(values, float), left=np.nan, right=np.nan)
        before = np.clip(np.searchsorted(stamps, clock, side="right") - 1, 0, len(stamps) - 2)
        steps = np.diff(stamps)
        missing = (steps > _GAP * np.median(steps))[before] & ~np.isin(clock, stamps)
        if name in _MEASURED and len(stamps) < _SAME_RATE * len(clock):
            missing |= ~_nearest(clock, stamps)
        columns.append(np.where(missing, np.nan, column))
    return RawTable(source=str(path), names=("t", *whole), values=np.stack(columns, axis=1), notes=notes)


def _nearest(clock: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(N,) True at the time of a clock that is nearest to one of the stamps."""
    after = np.clip(np.searchsorted(clock, stamps), 1, len(clock) - 1)
    nearest = np.where(stamps - clock[after - 1] < clock[after] - stamps, after - 1, after)
    at = np.zeros(len(clock), dtype=bool)
    at[nearest[(stamps >= clock[0]) & (stamps <= clock[-1])]] = True
    return at


def _number(cell: Any) -> float | None:
    """The number of a cell of a sheet; NaN where it is empty, None where it is text."""
    if cell is None:
        return np.nan
    if hasattr(cell, "timestamp"):
        return seconds_of(cell.isoformat())
    if isinstance(cell, (int, float)) and not isinstance(cell, bool):
        return float(cell)
    stripped = str(cell).strip()
    return np.nan if not stripped else seconds_of(stripped)


def library(module: str, path: Path, extra: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module}; install it with: pip install 'casid[{extra}]', or save it as CSV"
        ) from None


def read_mat(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .mat file: its one matrix, without names, or one vector per channel, also as fields of a struct.

    scipy reads it; with some forged flags in the header scipy itself crashes, so that no error can be raised.
    """
    from scipy.io import loadmat  # here, because few records are .mat and scipy.io is slow to import

    try:
        content = loaded(path, lambda: loadmat(str(path)))
    except NotImplementedError:  # version 7.3 is HDF5
        return read_hdf5(path, variable, time)
    return table_of(path, {k: v for k, v in content.items() if not k.startswith("__")}, variable, time)


def read_npz(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .npz file: its one matrix, without names, or one vector per channel. Pickled objects are refused."""

    def load() -> dict[str, Any]:
        # opened here: numpy leaves a damaged file open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive)

    return table_of(path, loaded(path, load), variable, time)


def read_parquet(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .parquet file; needs the extra `parquet`."""
    try:
        parquet = import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            f"{path}: reading .parquet needs pyarrow; install it with: pip install 'casid[parquet]', or save as CSV"
        ) from None

    def load() -> dict[str, Any]:
        content = parquet.read_table(path)
        return {name: content.column(name).to_numpy() for name in content.column_names}

    return table_of(path, loaded(path, load), variable, time)
