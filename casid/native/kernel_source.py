"""C source of a model's kernel: simulate segments, or linearise them and gather their Gram blocks on the way.

Lanes are segments. `data` holds per W segments and sample the vectors u0 (m), u1 (m), dt, z (o) and which row of the
tables below says what is present; all else is in numpy's order, segment by segment. S (columns n+f, rows n) is the
sensitivity of the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from casid.native.emitter import emit, prelude
from casid.native.kkt_source import REDUCE


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


STAGES = (1, 2, 3, 4)


def sizes_of(linear: ca.Function, noises: int) -> Sizes:
    """From the function that `stage_functions` gives second."""
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
    stages = {f"{name}{stage}": rest[3 * (stage - 1) + i] for stage in STAGES for i, name in enumerate("FQE")}
    constants = {"N": s.n, "M": s.m, "Q": s.q, "O": s.o, "F": s.f, "NF": s.n + s.f, "NV": s.v, "STRIDE": s.stride}
    arrays = {"C": C, "D": D, **stages}
    rows = sorted({i for name, pattern in stages.items() if name[0] == "Q" for i, _, _ in _entries(pattern)})
    constants["DRIVEN"] = max(len(rows), 1)
    names = ", ".join(arrays)
    return "\n".join(
        [
            prelude(),
            *(f"#define {name} {value}" for name, value in constants.items()),
            emit(plain, "advance"),
            emit(linear, "derive"),
            "#define STAGE_ARRAYS V "
            + ", ".join(f"{name}[{max(pattern.nnz(), 1)}]" for name, pattern in arrays.items()),
            f"#define STAGES {names}",
            _along_outputs(C, D, s),
            _column("homogeneous", stages, s, []),
            _column("driven", stages, s, rows),
            _drives(stages, rows),
            *([_COVARIANCE] if s.v else []),
            _BODY,
            REDUCE,
        ]
    )


def _entries(pattern: ca.Sparsity) -> list[tuple[int, int, int]]:
    """(row, column, position) of the nonzeros."""
    rows, columns = pattern.get_triplet()
    return [(row, column, k) for k, (row, column) in enumerate(zip(rows, columns, strict=True))]


def _sum(terms: list[str]) -> str:
    return " + ".join(terms) if terms else "(V){0}"


def _along_outputs(c: ca.Sparsity, d: ca.Sparsity, s: Sizes) -> str:
    """q = C S + [0 D]"""
    lines = ["static inline void outputs(V (*restrict q)[NF], const V *C, const V *D, V (*restrict S)[N])", "{"]
    lines.append("for (int c = 0; c < NF; c++) { const V *s = S[c];")
    for row in range(s.o):
        lines.append(f"q[{row}][c] = {_sum([f'C[{k}] * s[{j}]' for i, j, k in _entries(c) if i == row])};")
    lines.append("}")
    lines += [f"q[{i}][N + {j}] += D[{k}];" for i, j, k in _entries(d)]
    return "\n".join([*lines, "}"])


_PATTERNS = "const V *F1, const V *F2, const V *F3, const V *F4, const V *E1, const V *E2, const V *E3, const V *E4"


def _column(name: str, stages: dict[str, ca.Sparsity], s: Sizes, rows: list[int]) -> str:
    """One column of sensitivities over the step, with what drives the `rows` of it in each stage."""
    lines = [f"static inline void {name}(V *restrict s, V (*restrict d)[DRIVEN], V dt, {_PATTERNS})", "{"]
    lines.append("const V half = 0.5 * dt, sixth = dt / 6.0;")
    lines += [f"const V s{j} = s[{j}];" for j in range(s.n)]
    for stage in STAGES:
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
        lines.append(f"s[{j}] = s{j} + sixth * (k1_{j} + 2.0 * (k2_{j} + k3_{j}) + k4_{j});")
    return "\n".join([*lines, "}"])


def _drives(stages: dict[str, ca.Sparsity], rows: list[int]) -> str:
    """The columns of all Q, in the rows that any of them drives."""
    arrays = ", ".join(f"const V *Q{stage}" for stage in STAGES)
    lines = [f"static inline void drives(V (*restrict d)[4][DRIVEN], {arrays})", "{"]
    for stage in STAGES:
        for i, j, k in _entries(stages[f"Q{stage}"]):
            lines.append(f"d[{j}][{stage - 1}][{rows.index(i)}] = Q{stage}[{k}];")
    return "\n".join([*lines, "}"])


# P <- A P A' + sum G G'; noise of intensity sigma, held over dt, has the standard deviation sigma/sqrt(dt)
_COVARIANCE = r"""
#define PATTERNS F1, F2, F3, F4, E1, E2, E3, E4
static inline void turn(V (*restrict P)[N])
{
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) {
            V held = P[i][j];
            P[i][j] = P[j][i];
            P[j][i] = held;
        }
}

static inline void spread(V (*restrict P)[N], V (*restrict d)[4][DRIVEN], V dt, const double *intensity,
                          const V *F1, const V *F2, const V *F3, const V *F4,
                          const V *E1, const V *E2, const V *E3, const V *E4)
{
    V rate = dt;
    for (int l = 0; l < W; l++) rate[l] = 1.0 / fmax(dt[l], 1e-12);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, PATTERNS);
    turn(P);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, PATTERNS);
    for (int k = 0; k < NV; k++) {
        V g[N];
        memset(g, 0, sizeof g);
        driven(g, d[F + k], dt, PATTERNS);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) P[i][j] += g[i] * g[j] * (rate * (intensity[k] * intensity[k]));
    }
}
"""

_BODY = r"""
#define SEGMENT(l) (first + (l) < count ? first + (l) : count - 1)

int lanes(void) { return W; }

static inline void gather(V *to, const double *from, int width, long first, long count)
{
    for (int i = 0; i < width; i++)
        for (int l = 0; l < W; l++) to[i][l] = from[SEGMENT(l) * width + i];
}

static inline void scatter(double *to, const V *from, int width, long row, long rows, long first, long count)
{
    for (int l = 0; l < W && first + l < count; l++)
        for (int i = 0; i < width; i++) to[((first + l) * rows + row) * width + i] = from[i][l];
}

#define PATTERN (2 * M + 1 + O)
#define TRIANGLE (O * (O + 1) / 2)

/* the row of a table that each lane's pattern says; `held` is the pattern that `to` is of already */
static inline void choose(V *to, V *held, const V *pattern, const double *table, int width)
{
    if (!memcmp(held, pattern, sizeof(V))) return;
    *held = *pattern;
    for (int l = 0; l < W; l++)
        for (int i = 0; i < width; i++) to[i][l] = table[(long)(*pattern)[l] * width + i];
}

/* live (blocks): samples after which nothing but padding follows; seen (patterns, O): 1 where present;
   states (count, length, N), y (count, length, O), end (count, N), squares (count, O) of present residuals */
void simulate(long count, long length, const long *live, const V *data, const double *nodes, const double *parameters,
              const double *seen, double *states, double *y, double *end, double *squares)
{
    for (long first = 0; first < count; first += W, data += length * STRIDE) {
        const V *d = data;
        V x[N], p[Q], after[N], out[O], sum[O], present[O], held = (V){0} - 1.0;
        gather(x, nodes, N, first, count);
        gather(p, parameters, Q, first, count);
        for (int i = 0; i < O; i++) sum[i] = (V){0};
        for (long k = 0; k < live[first / W]; k++, d += STRIDE) {
            advance(x, d, d + M, d + 2 * M, p, after, out);
            scatter(states, x, N, k, length, first, count);
            scatter(y, out, O, k, length, first, count);
            choose(present, &held, d + PATTERN, seen, O);
            for (int i = 0; i < O; i++) {
                V r = (out[i] - d[2 * M + 1 + i]) * present[i];
                sum[i] += r * r;
            }
            for (int i = 0; i < N; i++) x[i] = after[i];
        }
        for (long k = live[first / W]; k < length; k++) {
            scatter(states, x, N, k, length, first, count);
            scatter(y, out, O, k, length, first, count);
        }
        scatter(end, x, N, 0, 1, first, count);
        scatter(squares, sum, O, 0, 1, first, count);
    }
}

static inline void accumulate(V *restrict H, V (*restrict g)[NF], V (*restrict q)[NF], const V *r)
{
    for (int i = 0; i < O; i++)
        for (int c = 0; c < NF; c++) g[i][c] += q[i][c] * r[i];
    for (int c = 0; c < NF; c++)
        for (int d = 0; d <= c; d++) {
            V h = *H;
            for (int i = 0; i < O; i++) h += q[i][c] * q[i][d];
            *H++ = h;
        }
}

/* q <- L q, r <- L r with the lower triangle L by rows */
static inline void whiten(V (*restrict q)[NF], V *restrict r, const V *restrict L, long dense)
{
    for (int i = O - 1; i >= 0; i--) {
        const V *row = L + i * (i + 1) / 2;
        r[i] *= row[i];
        for (int c = 0; c < NF; c++) q[i][c] *= row[i];
        if (!dense) continue;
        for (int j = 0; j < i; j++) {
            r[i] += row[j] * r[j];
            for (int c = 0; c < NF; c++) q[i][c] += row[j] * q[j][c];
        }
    }
}

/* weights (patterns, TRIANGLE): by rows, the factor that whitens the residuals, dense when more than its diagonal is
   not zero; hessian (count, NF, NF), gradient (count, O, NF) of each whitened residual, transition (count, N, NF),
   end (count, N),
   covariance (count, N, N) when NV, rows (count, length, O, NF) may be NULL */
void linearise(long count, long length, const long *live, const V *data, const double *nodes, const double *parameters,
               const double *weights, long dense, const double *intensity, double *hessian, double *gradient,
               double *transition, double *end, double *covariance, double *rows)
{
    for (long first = 0; first < count; first += W, data += length * STRIDE) {
        const V *d = data;
        V x[N], p[Q], after[N], out[O], r[O], S[NF][N], q[O][NF], g[O][NF], H[NF * (NF + 1) / 2];
        V drive[F + NV + 1][4][DRIVEN];
        V L[TRIANGLE], held = (V){0} - 1.0;
        STAGE_ARRAYS;
        gather(x, nodes, N, first, count);
        gather(p, parameters, Q, first, count);
        memset(S, 0, sizeof S);
        memset(drive, 0, sizeof drive);
        memset(g, 0, sizeof g);
        memset(H, 0, sizeof H);
        for (int i = 0; i < N; i++) S[i][i] = (V){0} + 1.0;
#if NV
        V P[N][N];
        memset(P, 0, sizeof P);
#endif
        for (long k = 0; k < live[first / W]; k++, d += STRIDE) {
            derive(x, d, d + M, d + 2 * M, p, after, out, STAGES);
            drives(drive, Q1, Q2, Q3, Q4);
            outputs(q, C, D, S);
            choose(L, &held, d + PATTERN, weights, TRIANGLE);
            for (int i = 0; i < O; i++) r[i] = out[i] - d[2 * M + 1 + i];
            whiten(q, r, L, dense);
            if (rows) scatter(rows, q[0], O * NF, k, length, first, count);
            accumulate(H, g, q, r);
            for (int c = 0; c < N; c++) homogeneous(S[c], 0, d[2 * M], F1, F2, F3, F4, E1, E2, E3, E4);
            for (int c = 0; c < F; c++) driven(S[N + c], drive[c], d[2 * M], F1, F2, F3, F4, E1, E2, E3, E4);
#if NV
            spread(P, drive, d[2 * M], intensity, F1, F2, F3, F4, E1, E2, E3, E4);
#endif
            for (int i = 0; i < N; i++) x[i] = after[i];
        }
        scatter(end, x, N, 0, 1, first, count);
        scatter(gradient, g[0], O * NF, 0, 1, first, count);
#if NV
        scatter(covariance, P[0], N * N, 0, 1, first, count);
#endif
        for (int l = 0; l < W && first + l < count; l++) {
            double *h = hessian + (first + l) * NF * NF, *t = transition + (first + l) * N * NF;
            for (int c = 0, at = 0; c < NF; c++) {
                for (int d = 0; d <= c; d++) h[c * NF + d] = h[d * NF + c] = H[at++][l];
                for (int i = 0; i < N; i++) t[i * NF + c] = S[c][i][l];
            }
        }
    }
}
"""
