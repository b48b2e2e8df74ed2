"""Arithmetic of the kernel counted from its source, and what the processor can do at most."""

from __future__ import annotations

import ctypes
import time

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.estimation.transcriptions.kernel import FLAGS
from casid.native.compiler import compile_library
from casid.native.kernel_source import sizes_of

_FUSED = r"""
#if defined(__AVX512F__)
#define W 8
#elif defined(__AVX__)
#define W 4
#else
#define W 2
#endif
typedef double V __attribute__((vector_size(8 * W)));
#define CHAINS 16
double peak(long rounds)
{
    V a[CHAINS], b = (V){0} + 0.999999, c = (V){0} + 1e-6, sum = (V){0};
    for (int i = 0; i < CHAINS; i++) a[i] = (V){0} + i;
    for (long k = 0; k < rounds; k++)
        for (int i = 0; i < CHAINS; i++) a[i] = a[i] * b + c;
    for (int i = 0; i < CHAINS; i++) sum += a[i];
    return sum[0];
}
int lanes(void) { return W; }
"""
_TRIALS, _ROUNDS, _CHAINS = 15, 2_000_000, 16
_UNCOUNTED = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN}


def peak_gflops() -> float:
    """Of fused multiply-adds in independent chains on one core, the best of several trials [1e9/s]."""
    library = compile_library(_FUSED, (*FLAGS, "-O3"))
    if library is None:
        raise InputError("bench_peak: no C compiler, so no compiled kernel to measure; install gcc or clang")
    loaded = ctypes.CDLL(str(library))
    loaded.peak.restype = ctypes.c_double
    best = np.inf
    for _ in range(_TRIALS):
        begin = time.perf_counter()
        loaded.peak(ctypes.c_long(_ROUNDS))
        best = min(best, time.perf_counter() - begin)
    return 2.0 * _CHAINS * _ROUNDS * int(loaded.lanes()) / best * 1e-9


def operations(function: ca.Function) -> int:
    """Arithmetic operations of one evaluation; a sine, a root or a division counts as one."""
    return sum(function.instruction_id(k) not in _UNCOUNTED for k in range(function.n_instructions()))


def linearise_operations(linear: ca.Function) -> int:
    """Arithmetic operations per sample of `linearise`: of the emitted function, of the columns of sensitivities over
    the four stages, of the outputs' sensitivities, and of the Gram matrix and gradients."""
    s = sizes_of(linear, 0)
    pattern = [linear.nnz_out(i) for i in range(linear.n_out())]
    C, D, stages = pattern[2], pattern[3], pattern[4:]
    columns = s.n + s.f
    steps = 2 * sum(f + e for f, e in zip(stages[0::3], stages[2::3], strict=True)) + (3 * 2 + 6) * s.n
    driven = sum(stages[1::3])
    gram = s.o * columns * (columns + 1) + 3 * s.o * columns
    return operations(linear) + columns * steps + driven + 2 * C * columns + D + gram
