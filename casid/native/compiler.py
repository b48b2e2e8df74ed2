"""CasADi functions on numpy arrays, through the CasADi virtual machine or, when it pays, as compiled C.

When compiling pays is unknown beforehand, so it is bought like skis. A function runs in the virtual machine until
the time it has spent there equals the estimated time to compile it, then it is compiled. That is never worse than
twice the best choice in hindsight. A library that is already in the cache is looked up far sooner, because that
only costs generating the source for its hash.
"""

from __future__ import annotations

import hashlib
import logging
import math
import os
import platform
import shutil
import signal
import subprocess
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casid.native.cache import check_loads, find, keep, workshop
from casid.native.emitter import UnknownOperationError
from casid.native.tape import Tape

# The bits are those of the virtual machine, so that it does not matter when a function is compiled: no fused products,
# and no pairs of a sum and a difference in one vector, which gcc fuses in spite of that
_SAME_BITS = ("-ffp-contract=off", "-fno-tree-slp-vectorize")
FLAGS = ("-O2", "-march=native", "-fno-math-errno", *_SAME_BITS, "-shared", "-fPIC")
_LOG = logging.getLogger(__name__)
# s, measured with gcc on one core
_COMPILE_BASE = 0.06
_COMPILE_PER_INSTRUCTION = 1.6e-4
_SOURCE_PER_INSTRUCTION = 2e-6  # s, to write and hash the C source
# CasADi lets go of Python's lock, and marks the expressions that it works on: one thread at a time may build from them
BUILDING = threading.RLock()
_BATCHES = 6  # sizes of which a function keeps its arrays
# s that a compilation may take, and more by byte of source: ten times the slowest that was measured (-O1, Hessians)
_LONGEST = 20.0
_LONGEST_PER_BYTE = 4e-5
_until: ContextVar[float] = ContextVar("_until", default=math.inf)
_FAILED = "compiling failed, the CasADi virtual machine is used"
_given_up: list[str] = []  # why this process compiles nothing more


@cache
def c_compiler() -> str | None:
    """Find the C compiler; None (reported once) when there is none, it was given up, or CASID_NO_COMPILER is set."""
    if _given_up or os.environ.get("CASID_NO_COMPILER"):
        return None
    for name in (os.environ.get("CC", "cc"), "gcc", "clang"):
        found = shutil.which(name)
        if found is not None and _version(found) is not None:
            return found
    _LOG.warning("no C compiler found: estimation runs in the CasADi virtual machine, slower")
    return None


@cache
def _version(compiler: str) -> str | None:
    """Return the version that the compiler prints; None when it cannot even do that."""
    try:
        return _run([compiler, "--version"], 10.0, dict(os.environ))
    except (OSError, subprocess.SubprocessError):
        return None


def _run(command: list[str], seconds: float, environment: dict[str, str]) -> str:
    """Run a command that may take so long, and return what it prints; what it has started ends with it."""
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, env=environment, start_new_session=True
    ) as process:
        try:
            out, error = process.communicate(timeout=seconds)
        except BaseException:
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command, out, error)
    return out


def _give_up(why: str) -> None:
    """Compile nothing more in this process, and report why."""
    if not _given_up:
        _LOG.warning("%s: %s", _FAILED, why)
        _given_up.append(why)
        c_compiler.cache_clear()


def compile_first() -> bool:
    """Return True if kernels are compiled before their first use (CASID_COMPILE_FIRST is set). When it is time that
    decides, a machine that is busy or has not compiled yet switches later, and their sums differ in the last digits.
    A `Compilable` does the same operations in the same order either way."""
    return bool(os.environ.get("CASID_COMPILE_FIRST"))


@cache
def _machine() -> str:
    """Return what a compiled library depends on besides its source: versions of compiler and C library, processor."""
    compiler = c_compiler()
    version = _version(str(compiler))
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    cpu = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    return f"{version}{platform.machine()}{cpu}{platform.libc_ver()}"


def _source(function: ca.Function) -> str:
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    return generator.dump()


def _key(source: str, flags: tuple[str, ...]) -> str:
    text = "\0".join([source, *flags, _machine(), ca.CasadiMeta.version()])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def cached_library(source: str, flags: tuple[str, ...] = FLAGS) -> Path | None:
    """The library of a C source, if it has been compiled before."""
    return find(_key(source, flags))


def compile_function(function: ca.Function) -> ca.Function | None:
    """The function as compiled C, from the cache or made now; None (and reported) when compiling fails."""
    library = compile_library(_source(function))
    return None if library is None else _load(function, library)


def _load(function: ca.Function, library: Path) -> ca.Function:
    return ca.external(function.name(), str(library))


@contextmanager
def compiling_until(deadline: float) -> Iterator[None]:
    """Compile nothing beyond a time of `time.perf_counter`, while within."""
    token = _until.set(deadline)
    try:
        yield
    finally:
        _until.reset(token)


def is_time_to_compile(seconds: float = 0.0) -> bool:
    """Return True if a compilation that takes so long would end in the time that is left."""
    return time.perf_counter() + seconds < _until.get()


def compile_library(source: str, flags: tuple[str, ...] = FLAGS) -> Path | None:
    """Find the library of a C source in the cache or make it; None (and reported once) where that fails, and where the
    time to compile is up."""
    library = cached_library(source, flags)
    compiler = c_compiler()
    if library is not None or compiler is None or not is_time_to_compile():
        return library
    try:
        with workshop() as folder:
            text = folder / "f.c"
            binary = folder / "f.so"
            text.write_text(source)
            options = [flag for flag in flags if not flag.startswith("-l")]
            libraries = [flag for flag in flags if flag.startswith("-l")]
            command = [compiler, *options, str(text), "-o", str(binary), *libraries, "-lm"]
            longest = min(_LONGEST + _LONGEST_PER_BYTE * len(source), _until.get() - time.perf_counter())
            _run(command, longest, {**os.environ, "TMPDIR": str(folder)})
            check_loads(binary)
            return keep(_key(source, flags), binary)
    except subprocess.CalledProcessError as error:  # of this source alone
        _LOG.warning("%s: %s", _FAILED, (error.stderr or str(error)).strip()[-200:])
    except subprocess.TimeoutExpired as error:
        if is_time_to_compile():
            _give_up(f"'{compiler}' has not ended after {error.timeout:.0f} s")
    except OSError as error:
        _give_up(str(error)[-200:])
    return None


_NO_C = ("CallbackInternal", "Newton")  # a Python function, and Newton's method of algebraic states


def _has_no_source(function: ca.Function) -> bool:
    """Return True if it contains a function from which no C can be made."""
    return any(one.class_name() in _NO_C for one in function.find_functions())


def _tape_of(function: ca.Function) -> Tape | None:
    """Return the tape of a function that calls Python, where that can be done for many points at once."""
    try:
        return Tape(function) if function.is_a("SXFunction") else None
    except UnknownOperationError:
        return None


class Compilable:
    """A CasADi function that becomes compiled C once it has earned it; `lock` is for those who call one of its batches
    from more than one thread."""

    def __init__(self, function: ca.Function) -> None:
        self.symbolic = function  # can be differentiated, which compiled code cannot
        self.function = function
        self.spent = 0.0
        self.lock = threading.Lock()
        instructions = function.n_instructions()
        self._look_up_after = _SOURCE_PER_INSTRUCTION * instructions
        self._compile_after = _COMPILE_BASE + _COMPILE_PER_INSTRUCTION * instructions
        self._pending: str | None = None  # its C source
        self._settled = _has_no_source(function)
        self._tape = _tape_of(function) if self._settled else None
        self._batches: OrderedDict[tuple, PointBatch] = OrderedDict()

    def _batch(self, key: tuple, derive: Callable[[ca.Function], ca.Function]) -> PointBatch:
        """The batch of `derive`, which `key` identifies; the most recent ones are kept, so that the next estimation of
        the same size finds its arrays ready. Not for two threads at once."""
        if key not in self._batches:
            self._batches[key] = PointBatch(self, derive)
        self._batches.move_to_end(key)
        if len(self._batches) > _BATCHES:
            self._batches.popitem(last=False)
        return self._batches[key]

    def mapped(self, count: int) -> Batch:
        """The function over `count` samples."""
        return self._tape.mapped if self._tape else self._batch(("map", count), lambda f: f.map(count))

    def write(self, arguments: Sequence[np.ndarray], results: Sequence[np.ndarray]) -> None:
        """Write what `mapped` returns of arguments (count, rows) to results (count, columns, rows), contiguous arrays:
        no copy is made. Not for two threads at once."""
        if self._tape:
            for to, found in zip(results, self._tape.mapped(*arguments), strict=True):
                to[...] = found.reshape(to.shape)
        else:
            count = len(results[0])
            self._batch(("write", count), lambda f: f.map(count)).write(arguments, results)

    def accumulated(self, length: int, count: int) -> Batch:
        """`count` sequences of `length` calls, each of which takes what the one before gave as its first argument."""
        if self._tape:
            return self._tape.accumulated
        key = ("accumulated", length, count)
        return self._batch(key, lambda f: f.mapaccum("accumulated", length).map(count))

    def current(self) -> ca.Function:
        """The function in the form that is to be used now."""
        if self._settled or self.spent < self._look_up_after:
            return self.function
        if c_compiler() is None:
            self._settled = True
            return self.function
        library = None
        if self._pending is None:  # looked for once: to hash the source and to read the folder at every call adds up
            with BUILDING:
                self._pending = _source(self.function)
            library = cached_library(self._pending)
        if library is None and self.spent >= self._compile_after and is_time_to_compile(self._compile_after):
            library = compile_library(self._pending)
            self._settled = library is not None or is_time_to_compile()
        if library is not None:
            self.function = _load(self.function, library)
            self._settled = True
        return self.function


Batch = Callable[..., list[np.ndarray]]  # a PointBatch, or what does the same


class PointBatch:
    """A function derived from a Compilable one (mapped over samples, accumulated over time), numpy in, numpy out.

    Arguments and results are (columns, rows) of the CasADi matrices, which is numpy's (samples, channels). The arrays
    that a call returns are overwritten by the next call.
    """

    def __init__(self, kernel: Compilable, derive: Callable[[ca.Function], ca.Function]) -> None:
        self._kernel = kernel
        self._derive = derive
        self._used: ca.Function | None = None
        self._derived: tuple[ca.Function, ca.Function] | None = None  # a function, and what was derived from it
        # casadi.FunctionBuffer, whose signatures the stubs misstate, and what calls it
        self._buffer: Any = None
        self._trigger: Any = None
        self._inputs: list[np.ndarray] = []
        self._outputs: list[np.ndarray] = []

    def _prepare(self) -> None:
        """Go over to the form of the function that is to be used now."""
        function = self._kernel.current()
        if function is self._used:
            return
        self._used = function
        if self._derived is None or self._derived[0] is not function:
            with BUILDING:
                self._derived = function, self._derive(function)
        self._buffer, self._trigger = self._derived[1].buffer()
        self._inputs = []
        self._outputs = []

    def _bind_own(self, f: ca.Function) -> None:
        self._inputs = [np.zeros((f.size2_in(i), f.size1_in(i))) for i in range(f.n_in())]
        self._outputs = [np.zeros((f.size2_out(i), f.size1_out(i))) for i in range(f.n_out())]
        self._bind(self._inputs, self._outputs)

    def _bind(self, arguments: Sequence[np.ndarray], results: Sequence[np.ndarray]) -> None:
        for arrays, set_one in ((arguments, self._buffer.set_arg), (results, self._buffer.set_res)):
            for i, array in enumerate(arrays):
                if array.size:
                    set_one(i, array.data)

    def _run(self) -> None:
        begin = time.perf_counter()
        self._trigger()
        self._kernel.spent += time.perf_counter() - begin

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        self._prepare()
        if self._derived is not None and not self._outputs:
            self._bind_own(self._derived[1])
        for held, given in zip(self._inputs, arguments, strict=True):
            held[...] = given.reshape(held.shape)
        self._run()
        return self._outputs

    def write(self, arguments: Sequence[np.ndarray], results: Sequence[np.ndarray]) -> None:
        """Write to the arrays `results` what a call returns; both contiguous. Not for a batch that is called too."""
        self._prepare()
        given = [np.ascontiguousarray(one, dtype=float) for one in arguments]  # copies live until the run has ended
        self._bind(given, results)
        self._run()
