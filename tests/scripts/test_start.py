"""Every experiment leaves in one line when it is interrupted. Truth: status 130, as a shell has it for Ctrl-C."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(path for folder in ("scripts", "benchmarks") for path in (REPO / folder).glob("*.py"))
SLOW = [str(path.relative_to(REPO)) for path in SCRIPTS if path.name != "first_hour.py"]


@pytest.mark.parametrize("name", SLOW)
def test_ctrl_c_while_a_script_is_imported(tmp_path: Path, name: str) -> None:
    """The signal comes with the first numerical package, whichever it is; nothing slow is imported before it."""
    stopped = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5.0)\n"
    for package in ("numpy", "casadi", "scipy", "matplotlib"):
        (tmp_path / f"{package}.py").write_text(stopped)
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{REPO}"}
    command = [sys.executable, str(REPO / name), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 130 and done.stdout == ""
    assert done.stderr == "interrupted; nothing had begun\n"


@pytest.mark.parametrize("script", sorted(path.stem for path in (REPO / "scripts").glob("*.py")))
def test_every_experiment_has_an_example_and_a_line_in_the_docs(script: str) -> None:
    """The options of the example are options of the script; the page of the experiments names it."""
    source = (REPO / "scripts" / f"{script}.py").read_text(encoding="utf-8")
    found = re.search(rf'epilog=\(?\s*"Example: python scripts/{script}\.py (.*?)"', source)
    if script != "first_hour":  # takes no arguments but a wheel
        assert found, f"{script}: --help has no example"
        assert all(f'"{option}"' in source for option in re.findall(r"--[a-z-]+", found[1]))
    assert f"scripts/{script}.py" in (REPO / "docs" / "how-often.md").read_text(encoding="utf-8")
