"""Output folders as one unit. Truth: what lies on the disk when the system refuses a call, or the process is killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from casid.errors import InputError
from casid.keeping import whole_file
from casid.report import folder as folders
from casid.report.folder import whole_folder

NEW = {"diagnosis.json": "new", "report.html": "new", "figures/a.svg": "new"}
OLD = {"diagnosis.json": "old", "report.html": "old", "figures/b.svg": "old", "of the user/notes.txt": "kept"}
AFTER = NEW | {"of the user/notes.txt": "kept"}
CALLS = ("os.rename", "os.mkdir", "os.chmod", "os.remove", "os.rmdir", "open")


class RefusedError(OSError):
    """The fault that the hook puts in."""


HOOK: dict[str, Any] = {"left": None, "act": None, "place": ""}


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    """Count the calls that change the disk below a place, and act at the one that is armed."""
    if HOOK["left"] is None or event not in CALLS or not str(arguments[0]).startswith(HOOK["place"]):
        return
    if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
        return
    HOOK["left"] -= 1
    if HOOK["left"] == 0:
        HOOK["act"]()


sys.addaudithook(_hook)


@pytest.fixture
def fault(tmp_path: Path) -> Iterator[Callable[..., None]]:
    """Arm the n-th call that changes the disk below `tmp_path`."""

    def arm(n: int, act: Callable[[], None]) -> None:
        HOOK.update(left=n, act=act, place=str(tmp_path))

    yield arm
    HOOK["left"] = None


def refuse() -> None:
    raise RefusedError(28, "No space left on device")


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def write(place: Path, files: dict[str, str]) -> None:
    with whole_folder(place) as inside:
        for name, text in files.items():
            (inside / name).parent.mkdir(exist_ok=True)
            (inside / name).write_text(text)


def there(place: Path) -> dict[str, str]:
    files = {str(p.relative_to(place)): p.read_text() for p in place.rglob("*") if p.is_file()}
    return {name: text for name, text in files.items() if not name.startswith(".")}


def before(place: Path) -> None:
    for name, text in OLD.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text)


def is_old_or_new(place: Path, old: dict[str, str], killed: bool = False) -> bool:
    """Whether results are those of one run, with what the user has there; after a kill that may come over later."""
    found = there(place) if place.exists() else {}
    mine = {} if killed else {name: text for name, text in old.items() if text == "kept"}
    return found == old or {name: text for name, text in found.items() if not killed or text != "kept"} == NEW | mine


@pytest.mark.parametrize("swap", ["exchange", "two renames", "in place"])
@pytest.mark.parametrize("first", [False, True], ids=["over old", "first"])
def test_whatever_call_is_refused_the_old_is_intact_or_the_new_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: Callable[..., None], swap: str, first: bool
) -> None:
    if swap == "two renames":
        monkeypatch.setattr(folders, "_exchanged", lambda one, other: False)
    ended = False
    for n in range(1, 100):
        place = tmp_path / f"run {n}" / "out"
        place.parent.mkdir()
        if not first:
            before(place)
        if swap == "in place":
            place.mkdir(exist_ok=True)
            monkeypatch.chdir(place)
        fault(n, refuse)
        try:
            write(place, NEW)
            ended = HOOK["left"] > 0
        except (InputError, RefusedError):
            pass
        HOOK["left"] = None
        write(tmp_path / f"run {n}" / "other", {"a": "b"})  # another folder beside it concerns nobody
        monkeypatch.chdir(tmp_path)
        assert is_old_or_new(place, {} if first else OLD), n
        write(place, NEW)
        assert there(place) == (NEW if first else AFTER), n
        assert sorted(p.name for p in place.parent.iterdir()) == ["other", "out"], n
        assert not list(place.glob(".*")), n
        if ended:
            return
    pytest.fail("the calls have no end")


@pytest.mark.skipif(sys.platform != "linux", reason="renames two folders at once")
def test_a_run_that_is_killed_at_any_call_leaves_one_of_both(tmp_path: Path, fault: Callable[..., None]) -> None:
    context = multiprocessing.get_context("fork")
    for n in range(1, 100):
        place = tmp_path / f"run {n}" / "out"
        before(place)
        fault(n, kill)
        running = context.Process(target=write, args=(place, NEW))
        running.start()
        HOOK["left"] = None
        running.join(60)
        assert is_old_or_new(place, OLD, killed=True) or not place.exists(), n
        write(place, NEW)  # the next run takes away or finishes what the killed one left
        assert there(place) == AFTER and [p.name for p in place.parent.iterdir()] == ["out"], n
        if running.exitcode == 0:
            return
    pytest.fail("the calls have no end")


def test_a_run_in_the_same_folder_is_left_alone(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out") as first:
        (first / "a").write_text("first")
        write(tmp_path / "out", {"b": "second"})
        assert (first / "a").read_text() == "first"
    assert there(tmp_path / "out") == {"a": "first", "b": "second"}


def test_links_are_not_followed_and_modes_stay(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "file").write_text("mine")
    (tmp_path / "link").symlink_to(victim)
    with pytest.raises(InputError, match="is a link"), whole_folder(tmp_path / "link"):
        pass
    before(tmp_path / "out")
    (tmp_path / "out" / "report.html").chmod(0o600)
    (tmp_path / "out").chmod(0o750)
    (tmp_path / "out" / "diagnosis.json").unlink()
    (tmp_path / "out" / "diagnosis.json").symlink_to(victim / "file")
    write(tmp_path / "out", NEW)
    assert (victim / "file").read_text() == "mine" and not (tmp_path / "out" / "diagnosis.json").is_symlink()
    assert stat.S_IMODE((tmp_path / "out" / "report.html").stat().st_mode) == 0o600
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o750


def test_a_file_keeps_its_mode_and_replaces_a_link(tmp_path: Path) -> None:
    secret, victim = tmp_path / "secret.csv", tmp_path / "victim"
    secret.write_text("old")
    secret.chmod(0o600)
    victim.write_text("mine")
    (tmp_path / "link.csv").symlink_to(victim)
    for path in (secret, tmp_path / "link.csv"):
        with whole_file(path) as temporary:
            if path == secret:
                assert stat.S_IMODE(temporary.stat().st_mode) == 0o600  # from the first byte on
            temporary.write_text("new")
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600 and secret.read_text() == "new"
    assert victim.read_text() == "mine" and (tmp_path / "link.csv").read_text() == "new"
    assert len(list(tmp_path.iterdir())) == 3


def test_a_signal_at_any_line_before_the_work_leaves_nothing(tmp_path: Path) -> None:
    """Ctrl-C raises where the program stands: at each line of the module in turn, up to the block itself."""
    before, begun, at = sys.gettrace(), False, 0
    while not begun:
        at, left = at + 1, at + 1

        def stopping(frame: FrameType, event: str, _: object) -> Callable | None:
            nonlocal left
            if frame.f_code.co_filename != folders.__file__:
                return None
            left -= event == "line"
            if left == 0:
                raise KeyboardInterrupt
            return stopping

        sys.settrace(stopping)
        try:
            with suppress(KeyboardInterrupt), whole_folder(tmp_path / "deep" / "out"):
                begun, left = True, sys.maxsize  # none in what is taken away
                raise KeyboardInterrupt
        finally:
            sys.settrace(before)
        assert not list(tmp_path.iterdir()), f"line {at}"
    assert at > 20
