"""Flight records from files, and back: text, .mat, .npz, and the formats of other programs behind extras."""

from __future__ import annotations

import csv
import glob
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casid.arguments import a_path, given, is_path, require
from casid.errors import InputError
from casid.keeping import whole_file
from casid.records import ardupilot, betaflight, crazyflie, foreign, hdf5, igc, mat, px4, ros, tlog
from casid.records.checks import checked_fields
from casid.records.column_map import ColumnMap
from casid.records.columns import FORMULA, split_header
from casid.records.limits import apart
from casid.records.record import Record
from casid.records.table import RawTable, read_text
from casid.signals import RADIAN_LIMITS, unit_of


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of files: how it ends, how it begins, and what reads it with the `variable` and the time of a map."""

    endings: tuple[str, ...]
    read: Callable[[Path, str | None, str], RawTable]
    begins: tuple[bytes, ...] = ()
    # module and extra, slow to import: once, and not in the process of each file
    library: tuple[str, str] | None = None


FORMATS = (
    Format(endings=(".csv", ".tsv", ".asc", ".txt", ".dat", ".log"), read=lambda path, variable, time: read_text(path)),
    Format(endings=(".mat",), read=mat.read_mat),
    Format(endings=(".npz",), read=foreign.read_npz),
    Format(endings=(".parquet",), read=foreign.read_parquet, begins=(b"PAR1",)),
    Format(endings=(".h5", ".hdf5"), read=hdf5.read_hdf5),
    Format(endings=(".xlsx",), read=foreign.read_excel, library=("openpyxl", "excel")),
    Format(endings=(".mf4",), read=foreign.read_mdf, begins=(b"MDF     4",)),
    Format(endings=(".ulg",), read=px4.read_ulog, begins=(b"ULog\x01",), library=("pyulog", "ulog")),
    Format(
        endings=(".bin",),
        read=ardupilot.read_ardupilot,
        begins=(b"\xa3\x95", ardupilot.TEXT),
        library=("pymavlink.DFReader", "ardupilot"),
    ),
    Format(endings=(".tlog",), read=tlog.read_tlog, library=("pymavlink.mavutil", "ardupilot")),
    Format(endings=(".bbl", ".bfl"), read=betaflight.read_betaflight, begins=(betaflight.MAGIC,)),
    Format(endings=(".mcap",), read=ros.read_mcap, begins=(ros.MAGIC,)),
    Format(
        endings=(".bag", ".db3"), read=ros.read_ros_bag, begins=(ros.MAGIC_1,), library=("rosbags.highlevel", "rosbags")
    ),
    Format(endings=(".igc",), read=igc.read_igc),
    Format(endings=(".usd",), read=crazyflie.read_crazyflie, begins=crazyflie.MAGICS),
)

# endings of files that are not read -> what makes one of them that is
_CONVERTED = {
    ".rlog": "convert it with logreader of openpilot, to CSV",
    ".xls": "save it as .xlsx",
    ".ods": "save it as .xlsx or CSV",
    **dict.fromkeys((".mf3", ".mdf"), "convert it with asammdf: MDF('FILE').convert('4.10').save('FILE.mf4')"),
    ".tdms": "convert it with nptdms: TdmsFile.read('FILE').as_dataframe().to_csv('FILE.csv')",
    ".pkl": "a pickle may run code; write it with pandas: to_csv or to_parquet",
    ".feather": "write it with pandas: read_feather('FILE').to_parquet('FILE.parquet')",
    ".json": "write a table: pandas.read_json('FILE').to_csv('FILE.csv')",
    ".nc": "netCDF 4 is HDF5: rename it to .h5; of netCDF 3, nccopy -k nc4 FILE FILE.h5 makes one",
    **dict.fromkeys((".gpx", ".kml"), "convert it with gpsbabel, to unicsv"),
    ".px4log": "convert it with sdlog2_dump.py of PX4, to CSV",
    ".slx": "run the model, and save its signals as .mat",
    ".fig": "save its data as .mat",
}

Span = tuple[float, float] | None  # begin and end of a part [s]

_IN_MEMORY = "; data in memory are cs.Record.from_frame(df) or cs.Record.from_arrays(name, t, channels)"


def read_record(
    path: str | Path,
    column_map: ColumnMap | Mapping[str, str] | str | Path | None = None,
    *,
    own: Collection[str] = (),
    between: Span = None,
) -> Record:
    """The flight record of one file, in SI units and radians; its name is the file's name without ending.

    A header may carry a unit, `alpha [deg]`; without one it is SI. `t` and at least one surface must be there. An empty
    cell or nan in a measured output is a missing sample; columns that casid does not know are kept. `record.notes`
    holds remarks.

    Parameters
    ----------
    path
        A table as text (.csv, .tsv, .asc, .txt, .dat), or a file of another format known by its ending: .mat, .npz,
        .parquet, .h5, .hdf5, .xlsx, .mf4, .ulg, .bin, .bbl, .mcap. Logs are known by their first bytes.
    column_map
        Which column of a foreign file is which channel: a `ColumnMap`, its TOML file, or a table like
        `{"alpha": "ALCG:deg"}`.
    own
        Channels of a system that is no aircraft. They are taken under these names, whatever they would mean of an
        aircraft, and neither a surface nor a length is asked for.
    between
        Begin and end [s] of the part of a long file that is taken, begin <= t < end; only that is checked.

    Returns
    -------
    Record
        Time `t` (N,) [s] and channels (N,).

    Raises
    ------
    InputError
        In one line with file, row, column and value: for text in a number, a ragged row, time that runs back, and gaps
        in an input. Also for degrees in a radian column, a name that is nearly that of a channel, and a
        record under 3 s or 50 samples.

    Examples
    --------
    >>> import casid as cs
    >>> record = cs.read_record("casid/cli/demo/m1.csv", between=(0.0, 10.0))
    >>> record.name, len(record), "alpha" in record
    ('m1', 500, True)
    """
    if not is_path(path):
        raise InputError(f"read_record: the path is {given(path)}; expected a file name{_IN_MEMORY}")
    path = a_path(path, "read_record")
    column_map = ColumnMap.of(column_map)
    with np.errstate(all="ignore"):  # absurd numbers overflow on the way to the check that refuses them
        return Record(**checked_fields(read_table(path, column_map), _stem(path), column_map, own, a_span(between)))


def read_records(
    paths: str | Path | Iterable[str | Path],
    column_map: ColumnMap | Mapping[str, str] | str | Path | None = None,
    *,
    own: Collection[str] = (),
    between: Span = None,
) -> list[Record]:
    """Records of files and of patterns like `flight/m*.csv`, each pattern in alphabetical order.

    Records of one name in different folders are called `folder/name`.

    Parameters
    ----------
    paths
        A file or a pattern, or several.
    column_map, own, between
        As in `read_record`, for all files.

    Returns
    -------
    list of Record
        In SI units and radians, in the order of `paths`.

    Raises
    ------
    InputError
        When a pattern matches nothing or a file is given twice, and as `read_record`.

    Examples
    --------
    >>> import casid as cs
    >>> [record.name for record in cs.read_records("casid/cli/demo/m[12].csv")]
    ['m1', 'm2']
    """
    read, refused = read_each(paths, column_map, own=own, between=between)
    for error in refused.values():
        raise error
    return read


def read_each(
    paths: str | Path | Iterable[str | Path],
    column_map: ColumnMap | Mapping[str, str] | str | Path | None = None,
    *,
    own: Collection[str] = (),
    between: Span = None,
) -> tuple[list[Record], dict[Path, InputError]]:
    """Records of those files that can be read, as `read_records` has them, and by file the errors of the others."""
    files = files_of(paths)
    if not files:
        raise InputError("no record was given; expected at least one file or pattern, like flight/m*.csv")
    for file in files:
        if sum(file.resolve() == other.resolve() for other in files) > 1:
            raise InputError(f"{file}: given twice; each record may take part once")
    column_map = ColumnMap.of(column_map)
    stems = [_stem(file) for file in files]
    read = list[Record]()
    refused = dict[Path, InputError]()
    for file in files:
        try:
            record = read_record(file, column_map, own=own, between=between)
        except InputError as error:
            refused[file] = error
            continue
        several = stems.count(_stem(file)) > 1
        read.append(record.renamed("/".join((*file.resolve().parts[-2:-1], _stem(file)))) if several else record)
    return read, refused


def files_of(paths: str | Path | Iterable[str | Path]) -> list[Path]:
    """The files of names and patterns, each pattern in alphabetical order; InputError where one is none."""
    items = [paths] if is_path(paths) else paths
    if not isinstance(items, Iterable) or hasattr(items, "columns"):
        raise InputError(f"read_records: got {given(items)}; expected file names or patterns{_IN_MEMORY}")
    return [file for item in items for file in _matches(item)]


def write_record(record: Record, path: str | Path) -> None:
    """Write a record as CSV that `read_record` reads back exactly: SI units, an empty cell for a missing sample.

    Parameters
    ----------
    record
        What is written: the time and every channel.
    path
        The file, which ends in .csv; one that exists is replaced.

    Raises
    ------
    InputError
        When `path` is not .csv or cannot be written, a channel's name cannot be written in a header, or the record has
        events.

    Examples
    --------
    >>> import tempfile, numpy as np, casid as cs
    >>> t = 0.02 * np.arange(200)
    >>> record = cs.Record(name="m1", t=t, channels={"q": 0.01 * np.sin(t), "delta_e": 0.02 * np.cos(t)})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cs.write_record(record, folder + "/m1.csv")
    ...     again = cs.read_record(folder + "/m1.csv")
    >>> bool(np.array_equal(again["q"], record["q"]))
    True
    """
    require(record, Record, "write_record: record", "cs.write_record(record, 'm1.csv')")
    path = a_path(path, "write_record")
    if path.suffix.lower() != ".csv":
        raise InputError(f"{path}: records are written as .csv; got '{path.suffix}'")
    if any(record.events.values()):
        raise InputError(
            f"record '{record.name}': a file cannot hold its events ({', '.join(record.events)}); keep them apart and "
            "give them with dataclasses.replace(record, events=...) when it is read"
        )
    for name in record.channels:
        if name in ("", "t") or split_header(name) != (name, ""):
            raise InputError(f"record '{record.name}': channel '{name}' cannot stand in a header; rename it")
        if not isinstance(record.hold, str) and name in record.hold and set("=,") & set(name):
            raise InputError(
                f"record '{record.name}': a file cannot say how '{name}' is held; rename it without = and ,"
            )
    columns = [["" if np.isnan(v) else repr(v) for v in record[name].tolist()] for name in ("t", *record.channels)]
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        if record.hold != "linear":
            file.write(f"# hold: {record.hold_in_words}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("t", *(_header(record, name) for name in record.channels)))
        writer.writerows(zip(*columns, strict=True))


def _header(record: Record, name: str) -> str:
    """The name of a channel; with its unit where values are right in that unit only."""
    large = np.abs(record[name]) > RADIAN_LIMITS.get(name, np.inf)
    written = f"'{name}" if name[0] in FORMULA else name  # which no spreadsheet evaluates
    return f"{written} [{unit_of(name)}]" if name in record.stated and large.any() else written


def _matches(item: str | Path) -> list[Path]:
    if not is_path(item):
        raise InputError(f"read_records: got {given(item)} in the list; expected file names or patterns")
    if a_path(item, "records").exists():
        return [Path(item)]
    found = [Path(name) for name in sorted(glob.glob(str(item)))]
    if not found:
        raise InputError(f"{item}: no such file, and no file matches it as a pattern")
    for file in found:
        if not file.exists():
            raise InputError(f"{file}: cannot be read: is a link to itself or to nothing")
    return found


def _stem(path: Path) -> str:
    """The name of a file without its ending, and without that of its packing."""
    return Path(path.stem).stem if path.suffix.lower() == ".gz" else path.stem


def read_table(path: Path, column_map: ColumnMap) -> RawTable:
    """The columns of a file as they are; see `read_record`."""
    if path.is_dir() and not path.suffix:
        raise InputError(f"{path}: is a folder; name the files in it, like '{path / '*.csv'}'")
    ending = Path(path.stem).suffix.lower() if path.suffix.lower() == ".gz" else path.suffix.lower()
    head = _head(path)
    found = [one for one in FORMATS if one.begins and head.startswith(one.begins)]
    found += [one for one in FORMATS if ending in one.endings]
    if not found:
        known = [e for one in FORMATS for e in one.endings]
        slip = next((one for one in known if sorted(one) == sorted(ending)), "")  # a typing error, as .cvs is
        how = f"did you mean '{slip}'? Rename it" if slip else "save it as CSV, or as another of these"
        how = _CONVERTED.get(ending, how)
        raise InputError(f"{path}: files of '{ending}' are not read: {how}; read are {', '.join(known)}")
    if path.suffix.lower() == ".gz" and found[0] is not FORMATS[0]:
        raise InputError(f"{path}: is packed, and only text is read packed; unpack it: gunzip {path}")
    terms = column_map.columns.get("t", ())
    arguments = column_map.variable, str(terms[0].column) if terms else "t"
    if found[0].library:
        foreign.library(found[0].library[0], path, found[0].library[1])
    return found[0].read(path, *arguments) if found[0] is FORMATS[0] else apart(found[0].read, path, *arguments)


def _head(path: Path) -> bytes:
    """The first bytes of a file, by which formats know themselves; none of one that cannot be read."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(32)
    except OSError:
        return b""


def a_span(value: Any) -> tuple[float, float] | None:
    """A pair of times [s], the second one later; InputError for anything else. None is none."""
    if value is None:
        return None
    try:
        begin, end = value
        if float(begin) < float(end):
            return float(begin), float(end)
    except (TypeError, ValueError):
        pass
    raise InputError(f"between is {given(value)}; expected two times in s, the first one earlier, like (10.0, 40.0)")
