"""Truth: compiled code and the virtual machine compute the same; the cache survives two processes and a killed one."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, needs_compiler, short_period

from casid.estimation import Ipopt, Problem, solve
from casid.estimation.transcriptions.steps import sample_derivatives, step_function
from casid.model.system import Model
from casid.native import cache, compiler
from casid.native import programme as compiled_programme
from casid.native.cache import cache_folder
from casid.native.compiler import Compilable, PointBatch, compile_function


def arguments(function, count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [0.1 * rng.standard_normal((count, function.size1_in(i))) for i in range(function.n_in())]


def either_way(function: ca.Function, given: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Results by compiled code and by the virtual machine."""
    count, compiled = len(given[0]), compile_function(function)
    assert compiled is not None
    native = compiled.map(count).call([a.T for a in given])
    machine = PointBatch(Compilable(function), lambda f: f.map(count))(*given)
    return [(np.asarray(ours).T, theirs) for ours, theirs in zip(native, machine, strict=True)]


@needs_compiler
def test_compiled_code_gives_the_bits_of_the_virtual_machine(own_cache):
    """It must not matter when a function is compiled, which time decides."""
    for function in (step_function(short_period()), sample_derivatives(short_period(), np.arange(5), ("q",))):
        for native, machine in either_way(function, arguments(function, 50)):
            np.testing.assert_array_equal(native, machine)
    assert len(list(own_cache.glob("*.so"))) == 2
    assert not list(own_cache.glob("building-*"))


def turned(rng: np.random.Generator) -> ca.Function:
    """A chain of rotations, stretched, with other operations between: sums and differences of products in pairs."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 6)
    found = [ca.SX(x[i]) for i in range(4)]
    single = (ca.sin, ca.cos, ca.tan, ca.exp, ca.sqrt, ca.atan, lambda a: 1.0 / a, lambda a: a**2, lambda a: a**1.5)
    for _ in range(12):
        a, b = (found[i] for i in rng.permutation(len(found))[:2])
        c, s, d = (p[int(i)] for i in rng.permutation(6)[:3])
        found += [c * a - s * b, s * a + c * b, a * b - d, a * b + d]
        found.append(single[rng.integers(len(single))](0.1 + a * a / (1.0 + b * b)))
    out = ca.vertcat(*found[-20:])
    return ca.Function("turned", [x, p], [ca.cse(out), ca.densify(ca.jacobian(out, x))])


@needs_compiler
@pytest.mark.parametrize("seed", range(3))
def test_compiled_code_gives_the_bits_of_the_virtual_machine_for_any_operations(own_cache, seed):
    rng = np.random.default_rng(seed)
    function = turned(rng)
    for native, machine in either_way(function, [rng.normal(size=(64, rows)) for rows in (4, 6)]):
        np.testing.assert_array_equal(native, machine)


@needs_compiler
def test_a_function_is_compiled_only_when_it_has_earned_it(own_cache):
    kernel = Compilable(step_function(short_period()))
    before = kernel.current()
    assert not own_cache.exists()
    kernel.spent = 1e3
    after = kernel.current()
    assert after is not before and len(list(own_cache.glob("*.so"))) == 1
    # a second process finds it long before it would compile it
    second = Compilable(step_function(short_period()))
    second.spent = 0.05
    assert second.current().class_name() == "External"


@needs_compiler
def test_what_a_killed_process_left_is_swept(own_cache):
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True, check=True
    )
    left = own_cache / f"building-{int(gone.stdout)}-1"
    left.mkdir(parents=True)
    (left / "f.c").write_text("half a")
    ours = own_cache / f"building-{os.getpid()}-1"  # another thread of a living process
    ours.mkdir()
    assert compile_function(step_function(short_period())) is not None
    assert not left.exists() and ours.exists()


@needs_compiler
def test_two_processes_may_compile_the_same_function(own_cache):
    code = (
        "from casid.native.compiler import compile_function\n"
        "import casadi as ca\n"
        "x = ca.SX.sym('x')\n"
        "f = compile_function(ca.Function('f', [x], [ca.sin(x) * x]))\n"
        "print(float(f(2.0)))\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(own_cache.parent)}
    both = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(2)
    ]
    for process in both:
        out, _ = process.communicate(timeout=120)
        assert process.returncode == 0 and float(out) == pytest.approx(2 * np.sin(2.0), rel=1e-15)
    assert [p.suffix for p in own_cache.iterdir()] == [".so"]


def estimate() -> dict[str, float]:
    record = flight(noise=NOISE, rng=np.random.default_rng(0))
    return solve(Problem(short_period(), [record], free=["*"], start=START)).values


def test_without_a_compiler_the_virtual_machine_gives_the_same_estimate(own_cache, monkeypatch):
    monkeypatch.setattr(compiler, "_COMPILE_BASE", -1.0)  # with a compiler: everything is compiled at once
    monkeypatch.setattr(compiler, "_SOURCE_PER_INSTRUCTION", -1.0)
    with_compiler = estimate()
    assert bool(list(own_cache.glob("*.so"))) == (compiler.c_compiler() is not None)
    compiler.c_compiler.cache_clear()
    monkeypatch.setenv("CASID_NO_COMPILER", "1")
    try:
        assert compiler.c_compiler() is None
        without = estimate()
    finally:
        compiler.c_compiler.cache_clear()
    assert without == pytest.approx(with_compiler, rel=1e-9)


def test_a_missing_compiler_is_said_once(monkeypatch, caplog):
    compiler.c_compiler.cache_clear()
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CASID_NO_COMPILER", raising=False)
    try:
        for _ in range(3):
            assert compiler.c_compiler() is None
    finally:
        compiler.c_compiler.cache_clear()
    assert [r.message for r in caplog.records] == [
        "no C compiler found: estimation runs in the CasADi virtual machine, slower"
    ]


def test_the_cache_is_in_the_users_cache_folder(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/home/somebody")
    assert str(cache_folder()) == "/home/somebody/.cache/casid"


@needs_compiler
@pytest.mark.parametrize("hessian", ["exact", "gauss-newton"])
def test_a_programme_of_ipopt_gives_the_same_compiled(hessian, own_cache, monkeypatch):
    """Once it has earned it; records of the same size share the library, and the price decides."""
    monkeypatch.setattr(compiled_programme, "_LOOK_UP_AFTER", 0.0)
    model = short_period()

    def fitted(estimate: Model, seed: int) -> list[float]:
        own = flight(noise=NOISE, rng=np.random.default_rng(seed))
        fit = solve(Problem(estimate, [own], free=["*"], start=START), solver=Ipopt(hessian=hessian))
        return list(fit.values.values())

    monkeypatch.setattr(compiled_programme, "_COMPILE_PER_BYTE", {"exact": np.inf, "given": np.inf})
    machine = [fitted(short_period(), seed) for seed in (1, 2)]
    assert not any(b"nlp_hess_l" in library.read_bytes() for library in own_cache.glob("*.so"))
    monkeypatch.setattr(compiled_programme, "_COMPILE_PER_BYTE", {"exact": 0.0, "given": 0.0})
    native = [fitted(model, seed) for seed in (1, 2)]
    np.testing.assert_allclose(native, machine, rtol=1e-12)
    # beside it there may be the motion's, by which a minimum is judged
    assert sum(b"nlp_hess_l" in library.read_bytes() for library in own_cache.glob("*.so")) == 1


def test_a_programme_of_ipopt_does_without_a_compiler(monkeypatch):
    monkeypatch.setattr(compiled_programme, "_LOOK_UP_AFTER", 0.0)
    monkeypatch.setattr(compiled_programme, "c_compiler", lambda: None)
    record = flight(noise=NOISE, rng=np.random.default_rng(1))
    assert solve(Problem(short_period(), [record], free=["*"], start=START), solver=Ipopt()).converged


def compiled() -> float:
    x = ca.SX.sym("x")
    function = compile_function(ca.Function("f", [x], [ca.sin(x) * x]))
    assert function is not None
    return float(function(2.0))  # pyright: ignore[reportArgumentType]


@needs_compiler
@pytest.mark.parametrize("content", [b"", b"garbage", None])
def test_a_library_that_is_not_what_its_name_says_is_built_again(own_cache, content):
    """An empty, a garbage and a truncated one: none is ever loaded."""
    compiled()
    (library,) = own_cache.glob("*.so")
    broken = library.read_bytes()[:3000] if content is None else content
    library.unlink()  # what is loaded stays whole
    library.write_bytes(broken)
    assert compiled() == pytest.approx(2.0 * np.sin(2.0), rel=1e-15)
    assert library.stat().st_size > 3000


@needs_compiler
def test_a_folder_that_others_may_write_to_is_not_used(own_cache, caplog):
    own_cache.mkdir(parents=True)
    own_cache.chmod(0o777)
    assert compiled() == pytest.approx(2.0 * np.sin(2.0), rel=1e-15)
    assert not list(own_cache.iterdir()) and "this run only" in caplog.text


@needs_compiler
@pytest.mark.parametrize("mode", [0o777, 0o757])
def test_a_folder_that_others_may_exchange_is_not_used(own_cache, caplog, mode):
    """Who may write to a folder above may rename this one and put another in its place."""
    own_cache.parent.chmod(mode)
    assert compiled() == pytest.approx(2.0 * np.sin(2.0), rel=1e-15)
    assert not list(own_cache.glob("*.so")) and "this run only" in caplog.text
    own_cache.parent.chmod(0o1777)  # there each may rename what is their own alone
    cache._folder.cache_clear()
    compiled()
    assert list(own_cache.glob("*.so"))


@needs_compiler
def test_a_library_that_others_may_write_to_is_built_again(own_cache, monkeypatch):
    compiled()
    (library,) = own_cache.glob("*.so")
    library.chmod(0o777)
    loaded = []
    monkeypatch.setattr(cache, "check_loads", loaded.append)
    compiled()
    assert library.stat().st_mode & 0o777 == 0o700
    assert library not in loaded


@needs_compiler
def test_a_new_folder_is_of_the_user_alone(own_cache):
    compiled()
    assert own_cache.stat().st_mode & 0o777 == 0o700


@needs_compiler
def test_the_cache_is_bounded_and_the_longest_unused_go_first(own_cache, monkeypatch):
    compiled()
    (library,) = own_cache.glob("*.so")
    old = own_cache / "old-0.so"
    old.write_bytes(bytes(10_000))
    os.utime(old, (1.0, 1.0))
    monkeypatch.setattr(cache, "MOST_BYTES", library.stat().st_size * 2 + 5_000)
    y = ca.SX.sym("y")
    assert compile_function(ca.Function("g", [y], [ca.cos(y)])) is not None
    assert not old.exists() and library.exists()


@pytest.fixture
def bad_compiler(own_cache, tmp_path, monkeypatch):
    """Write a compiler that answers to --version and else does what a line of shell says."""
    monkeypatch.setattr(compiler, "_given_up", [])

    def write(line: str) -> None:
        script = tmp_path / "bad-cc"
        script.write_text(f'#!/bin/sh\nfor word; do out="$word"; test "$word" = --version && exit 0; done\n{line}\n')
        script.chmod(0o755)
        monkeypatch.setenv("CC", str(script))
        compiler.c_compiler.cache_clear()
        compiler._machine.cache_clear()

    yield write
    compiler._given_up.clear()
    compiler.c_compiler.cache_clear()
    compiler._machine.cache_clear()


def in_the_machine(argument: str) -> bool:
    """Whether two new functions give their values, and stay in the virtual machine although they would pay."""
    x = ca.SX.sym(argument)
    for f in (ca.Function("f", [x], [ca.sin(x) * x]), ca.Function("g", [x], [ca.cos(x) - x])):
        kernel = Compilable(f)
        kernel.spent = 1e3
        used = kernel.current()
        if used.class_name() == "External" or float(used(2.0)) != float(f(2.0)):  # pyright: ignore[reportArgumentType]
            return False
    return True


@needs_compiler
@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("for w; do case $w in *.so) echo garbage > $w;; esac; done; exit 0", "invalid ELF|too short"),
        ("sleep 600 & sleep 600", "has not ended after 1 s"),  # with a child that would keep the pipe open
        ("exit 0", "No such file|cannot open"),
    ],
)
def test_a_compiler_that_lies_or_hangs_is_given_up_and_said_once(bad_compiler, monkeypatch, caplog, line, fault):
    monkeypatch.setattr(compiler, "_LONGEST", 1.0)
    bad_compiler(line)
    begin = time.monotonic()
    assert in_the_machine("x")
    assert time.monotonic() - begin < 20.0
    assert len(caplog.records) == 1 and re.search(fault, caplog.text) and compiler.c_compiler() is None


@needs_compiler
def test_a_kept_library_that_does_not_load_here_is_dropped_and_built_again(own_cache, caplog):
    """As a mount without execution or another C library leaves it: its content is what its name says."""
    compiled()
    (library,) = own_cache.glob("*.so")
    key = library.stem.rpartition("-")[0]
    library.unlink()
    foreign = own_cache.parent / "foreign"
    foreign.write_bytes(b"\x7fELF of another machine" * 100)
    bad = cache.keep(key, foreign)
    assert compiled() == pytest.approx(2.0 * np.sin(2.0), rel=1e-15)
    assert not bad.exists() and len(list(own_cache.glob("*.so"))) == 1
    assert caplog.text.count("does not load") == 1


@needs_compiler
@pytest.mark.parametrize("place", ["parent", "folder", "library"])
def test_a_cache_without_permission_is_no_traceback(own_cache, monkeypatch, caplog, place):
    """Truth: the operating system's refusal, raised at each place where the cache asks it."""
    compiled()
    (library,) = own_cache.glob("*.so")
    refused = {"parent": own_cache.parent, "folder": own_cache, "library": library}[place]

    def forbidden(original):
        def ask(path, *arguments, **named):
            if str(path).startswith(str(refused)):
                raise PermissionError(13, "Permission denied", str(path))
            return original(path, *arguments, **named)

        return ask

    for function in ("stat", "lstat", "read_bytes", "mkdir", "glob", "write_text"):
        monkeypatch.setattr(Path, function, forbidden(getattr(Path, function)))
    monkeypatch.setattr(cache, "_seen", {})
    cache._folder.cache_clear()
    monkeypatch.setattr(compiler, "_given_up", [])
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.sin(x) * x])
    kernel = Compilable(f)
    kernel.spent = 1e3
    assert float(kernel.current()(2.0)) == float(f(2.0))  # pyright: ignore[reportArgumentType]
    assert len(caplog.records) <= 1
    cache._folder.cache_clear()


@needs_compiler
def test_a_library_that_is_there_is_not_compiled_again(own_cache):
    compiled()
    (library,) = own_cache.glob("*.so")
    before = library.stat().st_ino
    compiled()
    assert library.stat().st_ino == before


@pytest.mark.skipif(not Path("/proc/cpuinfo").exists(), reason="the system does not tell what its processor can do")
def test_a_library_is_of_one_processor(monkeypatch):
    """Two processors of one name, of which one has more instructions, as under one home, have a key each."""
    keys = set()
    for flags in ("flags : sse2", "flags : sse2 avx512f"):
        monkeypatch.setattr(Path, "read_text", lambda self, *a, flags=flags, **k: f"model name : X\n{flags}\n")
        compiler._machine.cache_clear()
        keys.add(compiler._key("source", ("-O2",)))
    compiler._machine.cache_clear()
    assert len(keys) == 2


def test_a_library_is_of_one_c_library(monkeypatch):
    """Two versions of it, as under one home on two machines, have a key each."""
    keys = set()
    for version in ("2.28", "2.36"):
        monkeypatch.setattr("platform.libc_ver", lambda version=version: ("glibc", version))
        compiler._machine.cache_clear()
        keys.add(compiler._key("source", ("-O2",)))
    compiler._machine.cache_clear()
    assert len(keys) == 2


def test_a_compiler_that_fails_is_no_compiler(tmp_path, monkeypatch):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("CASID_NO_COMPILER", raising=False)
    compiler.c_compiler.cache_clear()
    try:
        assert compiler.c_compiler() is None
    finally:
        compiler.c_compiler.cache_clear()


@needs_compiler
def test_a_compilation_ends_with_the_time_that_it_has(monkeypatch, tmp_path):
    """By a compiler that never ends; the next problem, which has the time, is compiled."""
    slow = tmp_path / "cc"
    slow.write_text('#!/bin/sh\n[ "$1" = --version ] || sleep 30\n')
    slow.chmod(0o755)
    source = f"int of_{time.time_ns()}(void) {{ return 7; }}"  # in no cache
    with monkeypatch.context() as patched:
        patched.setattr(compiler, "c_compiler", lambda: str(slow))
        begin = time.perf_counter()
        with compiler.compiling_until(begin + 0.3):
            assert compiler.compile_library(source) is None
        assert time.perf_counter() - begin < 5.0
    assert compiler.compile_library(source) is not None


def test_what_would_not_end_in_time_is_not_begun():
    """Truth: a clock that has 100 s left; without a time there is always enough."""
    with compiler.compiling_until(time.perf_counter() + 100.0):
        assert compiler.is_time_to_compile() and compiler.is_time_to_compile(50.0)
        assert not compiler.is_time_to_compile(150.0)
        with compiler.compiling_until(time.perf_counter() - 1.0):
            assert not compiler.is_time_to_compile()
        assert compiler.is_time_to_compile(50.0)
    assert compiler.is_time_to_compile(1e9)


@needs_compiler
def test_a_kernel_for_which_there_was_no_time_is_compiled_later(tmp_path):
    """Truth: what a process does after a time limit does not depend on that limit."""
    code = (
        "from casid.filtering.kernel import filter_kernel\n"
        "from casid.native.compiler import compiling_until\n"
        "with compiling_until(0.0):\n"
        "    print(filter_kernel(2, 2) is None)\n"
        "print(filter_kernel(2, 2) is None)\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split() == ["True", "False"]
