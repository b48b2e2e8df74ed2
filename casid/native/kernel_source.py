"""C source of a model's kernel: simulate segments, or linearise them and gather their Gram blocks on the way.

Lanes are segments. `data` holds per W segments and sample the vectors u0 (m), u1 (m), dt, z (o) and which row of the
tables below shows what is present. All else is in numpy's order, segment by segment. S (columns n+f, rows n) is the
sensitivity of the state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.native.emitter import emit, prelude
from casid.native.sources import c_source


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """n states, m inputs, q model parameters, o outputs, f free parameters, v noises."""

    n: int
    m: int
    q: int
    o: int
    f: int
    v: int

    @property
    def stride(self) -> int:
        """Vectors of data per sample."""
        return 2 * self.m + 2 + self.o

    @property
    def constants(self) -> dict[str, int]:
        """Their names in the C sources."""
        sizes = {"N": self.n, "M": self.m, "Q": self.q, "O": self.o, "F": self.f, "NF": self.n + self.f}
        return sizes | {"STRIDE": self.stride}


def _stages(linear: ca.Function) -> range:
    """Numbers of the stages of a step: four of Runge and Kutta, or the one of a model in discrete time."""
    return range(1, (linear.n_out() - 4) // 3 + 1)


def sizes_of(linear: ca.Function, noises: int) -> Sizes:
    """Read the sizes from the function that `stage_functions` gives second."""
    return Sizes(
        n=linear.size1_in(0),
        m=linear.size1_in(1),
        q=linear.size1_in(4),
        o=linear.size1_out(1),
        f=linear.size2_out(3),
        v=noises,
    )


def kernel_source(plain: ca.Function, linear: ca.Function, noises: int) -> str:
    """The source. Raises emit.UnknownOperationError."""
    s = sizes_of(linear, noises)
    C, D, *rest = (linear.sparsity_out(i) for i in range(2, linear.n_out()))
    numbers = _stages(linear)
    stages = {f"{name}{stage}": rest[3 * (stage - 1) + i] for stage in numbers for i, name in enumerate("FQE")}
    factors = [f"{name}{stage}" for name in "FE" for stage in numbers]
    arrays = {"C": C, "D": D, **stages}
    rows = sorted({i for name, pattern in stages.items() if name[0] == "Q" for i, _, _ in _entries(pattern)})
    constants = s.constants | {"NV": s.v, "DRIVEN": max(len(rows), 1), "STAGE_COUNT": len(numbers)}
    return "\n".join(
        [
            prelude(),
            *(f"#define {name} {value}" for name, value in constants.items()),
            emit(plain, "advance"),
            emit(linear, "derive"),
            _arrays("STAGE_ARRAYS", arrays),
            f"#define STAGES {', '.join(arrays)}",
            f"#define FACTORS {', '.join(factors)}",
            f"#define FACTOR_ARGUMENTS {', '.join(f'const V *{name}' for name in factors)}",
            f"#define DRIVES {', '.join(f'Q{stage}' for stage in numbers)}",
            _along_outputs(C, D, s),
            _column("homogeneous", stages, s, []),
            _column("driven", stages, s, rows),
            _drives(stages, rows, numbers),
            *([c_source("covariance")] if s.v else []),
            c_source("lanes"),
            c_source("segments"),
            c_source("reduce"),
        ]
    )


def collocation_source(functions: Mapping[str, ca.Function], tau: np.ndarray, c: np.ndarray) -> str:
    """The source of the kernel of collocation. Of (x, u, p): "slope" f, "output" y, "slopes" f, F = df/dx, Q =
    df/dp_free, "outputs_of" y, C = dy/dx, D = dy/dp_free, all but f and y sparse; tau and c as `radau` gives them.
    Raises emit.UnknownOperationError."""
    s = collocation_sizes(functions)
    F, Q = (functions["slopes"].sparsity_out(i) for i in (1, 2))
    C, D = (functions["outputs_of"].sparsity_out(i) for i in (1, 2))
    constants = s.constants | {"DEGREE": len(tau)}
    rows = ", ".join("{" + ", ".join(repr(float(v)) for v in row) + "}" for row in c)
    return "\n".join(
        [
            prelude(),
            *(f"#define {name} {value}" for name, value in constants.items()),
            f"static const double TAU[DEGREE] = {{{', '.join(repr(float(v)) for v in tau)}}};",
            f"static const double COEF[DEGREE + 1][DEGREE] = {{{rows}}};",
            *(emit(function, name) for name, function in functions.items()),
            _arrays("COLLOCATION_ARRAYS", {"Cs": C, "Ds": D, "Fs": F, "Qs": Q}),
            _along_outputs_and_offset(C, D, s),
            c_source("lanes"),
            _pull(C, s),
            _subtract_slopes(F, Q, s),
            c_source("reduce"),
            c_source("collocate"),
        ]
    )


def collocation_sizes(functions: Mapping[str, ca.Function]) -> Sizes:
    """Read the sizes from the functions that `collocation_source` takes."""
    slopes = functions["slopes"]
    outputs = functions["outputs_of"]
    n, m, q = (slopes.size1_in(i) for i in range(3))
    return Sizes(n=n, m=m, q=q, o=outputs.size1_out(0), f=slopes.size2_out(2), v=0)


def _arrays(name: str, patterns: Mapping[str, ca.Sparsity]) -> str:
    """Declare an array for the nonzeros of each pattern, under one name."""
    declared = (f"{array}[{max(pattern.nnz(), 1)}]" for array, pattern in patterns.items())
    return f"#define {name} V {', '.join(declared)}"


def _function(head: str, lines: Iterable[str]) -> str:
    return "\n".join([f"static inline void {head}", "{", *lines, "}"])


def _pull(c: ca.Sparsity, s: Sizes) -> str:
    """C' L' of the whitened residual, which is in q: what the cost changes with the state."""
    lines = [
        "V w[O];",
        "for (int i = 0; i < O; i++) w[i] = L[i * (i + 1) / 2 + i] * q[i][NF];",
        "for (int i = 0; dense && i < O; i++)",
        "for (int j = 0; j < i; j++) w[j] += L[i * (i + 1) / 2 + j] * q[i][NF];",
    ]
    for column in range(s.n):
        parts = [f"where(C[{k}], L[{i * (i + 3) // 2}]) * w[{i}]" for i, j, k in _entries(c) if j == column]
        lines.append(f"to[{column}] = {_sum(parts)};")
    return _function("pull(V *to, V (*q)[NF + 2], const V *L, long dense, const V *C)", lines)


def _subtract_slopes(f: ca.Sparsity, q: ca.Sparsity, s: Sizes) -> str:
    """A and b of a point of collocation less dt times its slopes; `first` is the column of A where the point begins."""
    head = "V (*A)[DEGREE * N], V (*b)[1 + NF], int first, V dt, const V *Fs, const V *Qs"
    lines = [f"A[{i}][first + {j}] -= dt * Fs[{k}];" for i, j, k in _entries(f)]
    lines += [f"b[{i}][{1 + s.n + j}] = -dt * Qs[{k}];" for i, j, k in _entries(q)]
    return _function(f"subtract_slopes({head})", lines)


def _entries(pattern: ca.Sparsity) -> list[tuple[int, int, int]]:
    """(row, column, position) of the nonzeros."""
    rows, columns = pattern.get_triplet()
    return [(row, column, k) for k, (row, column) in enumerate(zip(rows, columns, strict=True))]


def _sum(terms: list[str]) -> str:
    return " + ".join(terms) if terms else "(V){0}"


def _along_outputs(c: ca.Sparsity, d: ca.Sparsity, s: Sizes) -> str:
    """q = C S + [0 D], of the columns of S."""
    lines = ["for (int c = 0; c < NF; c++) { const V *s = S[c];", *_times_c(c, s, "c", "s[{}]"), "}", *_plus_d(d)]
    return _function("outputs(V (*restrict q)[NF], const V *C, const V *D, V (*restrict S)[N])", lines)


def _along_outputs_and_offset(c: ca.Sparsity, d: ca.Sparsity, s: Sizes) -> str:
    """q = C S + [0 D], of the rows of S, and C o in its last column."""
    lines = ["for (int c = 0; c < NF; c++) {", *_times_c(c, s, "c", "S[{}][c]"), "}"]
    lines += [*_times_c(c, s, "NF + 1", "o[{}]"), *_plus_d(d)]
    head = "const V *C, const V *D, V (*restrict S)[NF], const V *o"
    return _function(f"along_outputs(V (*restrict q)[NF + 2], {head})", lines)


def _times_c(c: ca.Sparsity, s: Sizes, to: str, element: str) -> Iterator[str]:
    """Set a column of q to C times a vector, which has the `element` of each number."""
    for row in range(s.o):
        terms = [f"C[{k}] * {element.format(j)}" for i, j, k in _entries(c) if i == row]
        yield f"q[{row}][{to}] = {_sum(terms)};"


def _plus_d(d: ca.Sparsity) -> list[str]:
    return [f"q[{i}][N + {j}] += D[{k}];" for i, j, k in _entries(d)]


def _column(name: str, stages: dict[str, ca.Sparsity], s: Sizes, rows: list[int]) -> str:
    """One column of sensitivities over the step, with what drives the `rows` of it in each stage."""
    lines = ["const V half = 0.5 * dt, sixth = dt / 6.0;"]
    lines += [f"const V s{j} = s[{j}];" for j in range(s.n)]
    numbers = [stage for stage in (1, 2, 3, 4) if f"F{stage}" in stages]
    for stage in numbers:
        factor = {1: "", 2: "half", 3: "half", 4: "dt"}[stage]
        for j in range(s.n):
            at = f"s{j} + {factor} * k{stage - 1}_{j}" if factor else f"s{j}"
            lines.append(f"const V z{stage}_{j} = {at};")
        for row in range(s.n):
            terms = [f"F{stage}[{k}] * z{stage}_{j}" for i, j, k in _entries(stages[f"F{stage}"]) if i == row]
            terms += [f"E{stage}[{k}] * s{j}" for i, j, k in _entries(stages[f"E{stage}"]) if i == row]
            terms += [f"d[{stage - 1}][{rows.index(row)}]"] if row in rows else []
            lines.append(f"const V k{stage}_{row} = {_sum(terms)};")
    for j in range(s.n):
        advanced = f"s{j} + sixth * (k1_{j} + 2.0 * (k2_{j} + k3_{j}) + k4_{j})"
        lines.append(f"s[{j}] = {advanced if len(numbers) > 1 else f'k1_{j}'};")
    return _function(f"{name}(V *restrict s, V (*restrict d)[DRIVEN], V dt, FACTOR_ARGUMENTS)", lines)


def _drives(stages: dict[str, ca.Sparsity], rows: list[int], numbers: Iterable[int]) -> str:
    """The columns of all Q, in the rows that any of them drives."""
    arrays = ", ".join(f"const V *Q{stage}" for stage in numbers)
    lines = [
        f"d[{j}][{stage - 1}][{rows.index(i)}] = Q{stage}[{k}];"
        for stage in numbers
        for i, j, k in _entries(stages[f"Q{stage}"])
    ]
    return _function(f"drives(V (*restrict d)[STAGE_COUNT][DRIVEN], {arrays})", lines)
