"""Bounds on what is read. Truth: files that are larger, deeper or further off than they look; endless readers."""

from __future__ import annotations

import ctypes
import gzip
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.cli.options import DEMO
from casid.records import limits
from casid.records.limits import apart, read_bytes, xml_root

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="readers run in this process elsewhere")


def most_memory() -> int:
    """Largest memory of this process and of its children so far [bytes]."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return max(resource.getrusage(kind).ru_maxrss for kind in kinds) * 1024


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.bin"
    path.write_bytes(b"x")
    return path


def loops(path: Path) -> int:
    while True:
        pass


def waits(path: Path) -> int:
    time.sleep(600.0)
    return 0


def crashes(path: Path) -> int:
    return ctypes.string_at(0)[0]


def eats(path: Path) -> int:
    return len([np.empty(1 << 28, np.uint8) for _ in range(40)])


@on_linux
@pytest.mark.parametrize(
    ("read", "words"),
    [
        (loops, "was not read after 1 s"),
        (waits, "was not read after 1 s"),
        (crashes, "stopped its reader"),
        (eats, "needs too much memory"),
    ],
)
def test_a_reader_that_never_ends_or_breaks_is_one_line(monkeypatch, file, read, words):
    monkeypatch.setattr(limits, "_SECONDS", 1.0)
    begin, before = time.monotonic(), children()
    with pytest.raises(cs.InputError, match=words):
        apart(read, file)
    assert time.monotonic() - begin < 30.0
    assert children() <= before, "a reader is left"


def children() -> set[str]:
    """The processes that this one has started and that are still there."""
    return {pid for task in Path("/proc/self/task").glob("*/children") for pid in task.read_text().split()}


def test_what_a_reader_returns_or_raises_comes_over(file):
    values = np.random.default_rng(1).normal(size=(500_000, 8))  # far more than a pipe holds
    np.testing.assert_array_equal(apart(lambda path: values, file), values)

    def refuses(path: Path) -> None:
        raise cs.InputError(f"{path}: so")

    def fails(path: Path) -> None:
        raise ZeroDivisionError("so")

    with pytest.raises(cs.InputError, match="a.bin: so"):
        apart(refuses, file)
    with pytest.raises(ZeroDivisionError, match="so"):
        apart(fails, file)


def test_a_packed_file_is_not_unpacked_beyond_its_bound(tmp_path):
    """A thousand times as many bytes as the file has."""
    with gzip.open(tmp_path / "m.csv.gz", "wb", compresslevel=1) as packed:
        packed.write(b"t,delta_e,q\n")
        for _ in range(700):
            packed.write(b"0,0,0\n" * 150_000)
    before = most_memory()
    with pytest.raises(cs.InputError, match="has more than 537 MB"):
        cs.read_record(tmp_path / "m.csv.gz")
    assert most_memory() - before < 1.5e9


@pytest.mark.parametrize("name", ["dev.csv", "dev.toml", "dev.xml"])
def test_a_device_is_no_file(tmp_path, name):
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(cs.InputError, match="no file but a device"):
        cs.read_record(tmp_path / name) if name.endswith("csv") else cs.Aircraft.read(tmp_path / name)


def test_xml_is_read_to_a_depth():
    for depth, opening in ((99, "<a>"), (3000, "<a>"), (100_000, "<a x='1'>")):
        text = opening * depth + "</a>" * depth
        if depth < 100:
            assert sum(1 for _ in xml_root(text).iter()) == depth
            continue
        with pytest.raises(cs.InputError, match="more than 100 deep"):
            xml_root(text.encode())
    for broken in ("", "<a>", "<a></b>", "a", "<a/><b/>", "<a>\x00</a>"):
        with pytest.raises(cs.InputError, match="is no XML"):
            xml_root(broken)


@on_linux
def test_hdf5_does_not_read_other_files_nor_more_than_there_is(tmp_path):
    h5py = pytest.importorskip("h5py")
    secret = tmp_path / "secret"
    secret.write_bytes(np.arange(1000.0).tobytes())
    t = np.arange(1000.0)
    with h5py.File(tmp_path / "out.h5", "w") as other:
        other["t"] = t
        other.create_dataset("delta_e", (1000,), "f8", external=[(str(secret), 0, 8000)])
    with h5py.File(tmp_path / "virtual.h5", "w") as other:
        layout = h5py.VirtualLayout((1000,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "out.h5"), "t", (1000,))
        other["t"] = t
        other.create_virtual_dataset("delta_e", layout)
    with h5py.File(tmp_path / "big.h5", "w") as other:
        for name in ("t", "delta_e"):
            other.create_dataset(name, (400_000_000,), "f8", chunks=(1000,))
    for name, words in (("out", "another file"), ("virtual", "another file"), ("big", "too much memory")):
        with pytest.raises(cs.InputError, match=words):
            cs.read_record(tmp_path / f"{name}.h5")


@on_linux
def test_mat_and_npz_are_not_unpacked_beyond_memory(tmp_path, monkeypatch):
    import zipfile

    from scipy.io import savemat

    monkeypatch.setattr(limits, "_MOST_MEMORY", 1 << 27)
    savemat(tmp_path / "a.mat", {"x": np.zeros((3_000_000, 8))}, do_compression=True)
    assert (tmp_path / "a.mat").stat().st_size < 3e5
    head = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    head += b"{'descr': '<f8', 'fortran_order': False, 'shape': (400000000, 1)}".ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", head + bytes(1000))
    for name in ("a.mat", "a.npz"):
        with pytest.raises(cs.InputError):
            cs.read_record(tmp_path / name)


def test_a_cell_far_off_is_told(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["t", "delta_e"])
    book.active.cell(row=1_048_576, column=16_384, value=1.0)
    book.save(tmp_path / "far.xlsx")
    with pytest.raises(cs.InputError, match="delete what lies far off"):
        cs.read_record(tmp_path / "far.xlsx")


@pytest.mark.parametrize("named", ["/dev/zero", "../plane.dml", "/etc/passwd", "link.dml", "a\\u0000.dml"])
def test_a_file_that_an_aircraft_names_lies_beside_it_or_below(tmp_path, named):
    (tmp_path / "plane.dml").write_text("<DAVEfunc/>")
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "link.dml").symlink_to(tmp_path / "plane.dml")
    text = (DEMO / "aircraft.toml").read_text(encoding="utf-8").split("[aerodynamics]")[0]
    (folder / "a.toml").write_text(text + f'[aerodynamics]\ndaveml = "{named}"\n')
    with pytest.raises(cs.InputError, match="does not lie beside this file or below|cannot be the name"):
        cs.Aircraft.read(folder / "a.toml")


def test_a_text_has_a_bound_and_a_name_is_a_name(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"x" * 101)
    assert len(read_bytes(tmp_path / "a.csv", 101)) == 101
    with pytest.raises(cs.InputError, match="has more than"):
        read_bytes(tmp_path / "a.csv", 100)
    for wrong in ("no.csv", "a\x00.csv"):
        with pytest.raises(cs.InputError, match="cannot be read"):
            read_bytes(Path(wrong))


def test_an_error_that_only_its_library_can_make_is_one_line(tmp_path: Path) -> None:
    """Its class may need arguments that are lost on the way to another process (here: two)."""
    (file := tmp_path / "x.bbl").write_bytes(b"x")

    class DamagedError(Exception):
        def __init__(self, what: str, position: int) -> None:
            super().__init__(f"{what} at {position}")

    def fails(path: Path) -> None:
        raise DamagedError("head", 3)

    with pytest.raises(cs.InputError, match="DamagedError"):
        apart(fails, file)
