"""Fixtures that every test may use: the flight data, the scripts as modules or as processes, an empty kernel cache."""

from __future__ import annotations

import gc
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from types import ModuleType

import hypothesis
import pytest

os.environ["MPLBACKEND"] = "Agg"  # before anything imports matplotlib; scripts run as processes inherit it

# matplotlib's list of fonts is built afresh in each session: one that another environment left in the user's cache
# names fonts that are not there, and matplotlib then warns on stderr. Workers and processes inherit the folder.
if "PYTEST_XDIST_WORKER" not in os.environ:
    MATPLOTLIB_FOLDER = tempfile.TemporaryDirectory(prefix="casid-matplotlib-")  # removed when the session ends
    os.environ["MPLCONFIGDIR"] = MATPLOTLIB_FOLDER.name

REPO = Path(__file__).resolve().parent.parent
os.environ["PYTHONPATH"] = str(REPO)  # scripts run as processes take this checkout, whatever is installed
FLIGHT_DATA_FILE = "hfb320_1_10.asc"

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a shell; scripts would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(100_000)  # as commands of casid do: models are many small objects that stay

# The same examples in every run, and no clock: a busy machine is not a failure.
hypothesis.settings.register_profile("casid", derandomize=True, deadline=None)
hypothesis.settings.load_profile("casid")


@pytest.fixture(scope="session")
def repo() -> Path:
    """Root of the checkout."""
    return REPO


def data_folder(name: str, file: str) -> Path | None:
    """The data folder `name` that holds `file`, where CASID_DATA says, or in ../shared/data beside the checkout; None
    when there is none.

    CASID_DATA is that folder, the one that holds it, or one beside it.
    """
    root = Path(os.environ.get("CASID_DATA") or REPO.parent / "shared" / "data")
    return next((one for one in (root / name, root, root.parent / name) if (one / file).is_file()), None)


@pytest.fixture(scope="session")
def flight_data() -> Path:
    """Folder with the flight records of Jategaonkar's book (hfb320_1_10.asc, fAttasElv1.mat, ...).

    CASID_DATA names that folder or the one that holds it as `fvsysid`; without it, ../shared/data beside the checkout.
    The test is skipped when there is none, and fails when CASID_DATA is set but wrong.
    """
    if (folder := data_folder("fvsysid", FLIGHT_DATA_FILE)) is not None:
        return folder
    if named := os.environ.get("CASID_DATA"):
        pytest.fail(
            f"CASID_DATA={named} holds no {FLIGHT_DATA_FILE}; name the folder with the flight records, or unset it"
        )
    pytest.skip(
        "no flight data: download supplement 10.2514/4.102790 (flt_data.zip) of R. V. Jategaonkar, 'Flight Vehicle "
        "System Identification', from AIAA and set CASID_DATA to the folder with its records"
    )


@pytest.fixture(scope="session")
def known_faults_data() -> Path:
    """Folder with real flights whose faults are known (totter_f1_017.raw.csv, ...), as `sidpac` beside the flight data.

    The test is skipped when there is none.
    """
    if (folder := data_folder("sidpac", "totter_f1_017.raw.csv")) is not None:
        return folder
    pytest.skip(
        "no flights with known faults: convert the sample records of SIDPAC (NASA) into a folder 'sidpac' beside the "
        "flight data and set CASID_DATA to the folder that holds both"
    )


@pytest.fixture(scope="session")
def petab_data() -> Path:
    """Folder with problems of the PEtab benchmark collection, as `petab` beside the flight data; skipped without."""
    for name in ("Rahman_MBS2016", "Crauste_CellSystems2017"):
        if (folder := data_folder("petab", f"{name}/{name}.yaml")) is not None:
            return folder
    pytest.skip(
        "no PEtab problems: clone Benchmarking-Initiative/Benchmark-Models-PEtab, and set CASID_DATA to the folder "
        "that holds its problems as 'petab'"
    )


@pytest.fixture(scope="session")
def regression_data() -> Path:
    """Folder with the statistical reference data sets of NIST (MGH17.dat, ...), as `strd` beside the flight data.

    The test is skipped when there is none.
    """
    if (folder := data_folder("strd", "MGH17.dat")) is not None:
        return folder
    pytest.skip(
        "no reference data: get the nonlinear regression sets of NIST/ITL StRD (itl.nist.gov/div898/strd) into a "
        "folder 'strd' and set CASID_DATA to the folder that holds it"
    )


@pytest.fixture(scope="session")
def published_data(regression_data: Path) -> Path:
    """Folder `references` beside `strd`: data of COPS and of PEtab. The test is skipped when there is none."""
    folder = regression_data.parent / "references"
    if not (folder / "cops_pinene.csv").is_file():
        pytest.skip("no data of COPS and PEtab: folder 'references' beside 'strd', see problems/references/results.md")
    return folder


def script_file(name: str) -> Path:
    """The file of a script, a benchmark or a tool of the tests."""
    places = (REPO / folder / f"{name}.py" for folder in ("scripts", "benchmarks", "tests"))
    return next(place for place in places if place.exists())


@pytest.fixture(scope="session")
def load_script() -> Callable[[str], ModuleType]:
    """`load_script("table5")` imports the file of that name in scripts, benchmarks or tests as a module."""

    def load(name: str) -> ModuleType:
        qualified = f"casid_script_{name}"
        spec = importlib.util.spec_from_file_location(qualified, script_file(name))
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[qualified] = module  # dataclasses look their module up there
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def run_script() -> Callable[..., subprocess.CompletedProcess[str]]:
    """`run_script("table5", "--cases", "J")` runs scripts/table5.py as a user does, or a command of casid.

    Returns the finished process with `returncode`, `stdout` and `stderr`; the status is the test's to judge.
    `timeout` in seconds, `cwd` the folder to run in (the checkout's root).
    """

    def run(
        name: str, *arguments: object, timeout: float = 300.0, cwd: Path = REPO
    ) -> subprocess.CompletedProcess[str]:
        from casid.cli.app import COMMANDS

        program = ["-m", "casid", name] if name in COMMANDS else [str(script_file(name))]
        command = [sys.executable, *program, *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, timeout=timeout, cwd=cwd, stdin=subprocess.DEVNULL, check=False
        )

    return run


@pytest.fixture
def script_here(
    load_script: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """`script_here("table5", "--cases", "J")` runs a script in this process, which spares it the imports: exit status,
    standard output, standard error."""

    def run(name: str, *arguments: object) -> tuple[int, str, str]:
        from casid.cli.app import COMMANDS
        from casid.cli.run import script, status_of
        from casid.cli.start import outcome

        words = [str(argument) for argument in arguments]
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
        capsys.readouterr()
        if name in COMMANDS:  # the script is one command of casid
            status = status_of(script(resolve_name(COMMANDS[name])), words)
        else:
            status = outcome(load_script(name).main)
        return (status, *capsys.readouterr())

    return run


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """The folder of compiled kernels, empty and of this test alone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "casid"
