"""The C source of `filter_kernel`; the numpy versions in `kalman` and `innovations` say what it computes.

Every function runs the parts `from` to `to` of its work: records, samples or tiles of columns. MOST, the largest number
of states or outputs, and TILE, the columns that go through the filter side by side, are defined when it is compiled.
"""

SOURCE = r"""
#include <math.h>
#include <stdlib.h>
#include <string.h>
#ifdef __SSE__
#include <xmmintrin.h>
/* responses die out to numbers too small to be normal, which processors are slow with: to zero with them */
#define BEGIN unsigned before = _mm_getcsr(); _mm_setcsr(before | 0x8040);
#define END _mm_setcsr(before);
#else
#define BEGIN
#define END
#endif

typedef double V __attribute__((vector_size(64)));
#define WIDTH 8 /* numbers in a vector */

/* rows of vectors: c (height, 1 or 2 of `wide`) += sign a (height, the first `most` of inner) b (most, the same) */
static inline __attribute__((always_inline)) void block(int height, int two, long most, long inner, long wide,
                                                        const double *a, const V *b, V *c, double sign)
{
    V s[4], t[4];
    for (int i = 0; i < height; i++) {
        s[i] = c[i * wide];
        if (two) t[i] = c[i * wide + 1];
    }
    for (long j = 0; j < most; j++) {
        V x = b[j * wide], y = two ? b[j * wide + 1] : x;
        for (int i = 0; i < height; i++) {
            double f = sign * a[i * inner + j];
            s[i] += f * x;
            if (two) t[i] += f * y;
        }
    }
    for (int i = 0; i < height; i++) {
        c[i * wide] = s[i];
        if (two) c[i * wide + 1] = t[i];
    }
}

/* c (rows, wide) += sign a (rows, inner) b (inner, wide), b and c in rows of `wide` vectors; of a lower triangle a only
   what is not zero when `triangle` is set. Four rows at a time, so that what is read of b serves four times. */
static inline void product(long rows, long inner, long wide, const double *a, const V *b, V *c, double sign,
                           int triangle)
{
    for (long v = 0; v < wide; v += 2) {
        int two = v + 1 < wide;
        long i = 0;
        for (; i + 4 <= rows; i += 4) {
            long most = triangle ? i + 4 : inner;
            if (two) block(4, 1, most, inner, wide, a + i * inner, b + v, c + i * wide + v, sign);
            else block(4, 0, most, inner, wide, a + i * inner, b + v, c + i * wide + v, sign);
        }
        for (; i < rows; i++) {
            long most = triangle ? i + 1 : inner;
            if (two) block(1, 1, most, inner, wide, a + i * inner, b + v, c + i * wide + v, sign);
            else block(1, 0, most, inner, wide, a + i * inner, b + v, c + i * wide + v, sign);
        }
    }
}

static void zero(long rows, long wide, V *to) { memset(to, 0, rows * wide * sizeof(V)); }

/* rows of doubles to rows of vectors, and back; turned: to those of the transposed */
static void pack(long rows, long columns, long wide, const double *from, V *to)
{
    zero(rows, wide, to);
    for (long i = 0; i < rows; i++) memcpy(to + i * wide, from + i * columns, columns * sizeof(double));
}

static void pack_turned(long rows, long columns, long wide, const double *from, V *to)
{
    double *d = (double *)to;
    zero(columns, wide, to);
    for (long i = 0; i < rows; i++) for (long j = 0; j < columns; j++) d[j * wide * WIDTH + i] = from[i * columns + j];
}

static void unpack(long rows, long columns, long wide, const V *from, double *to)
{
    for (long i = 0; i < rows; i++) memcpy(to + i * columns, from + i * wide, columns * sizeof(double));
}

static void unpack_turned(long rows, long columns, long wide, const V *from, double *to)
{
    const double *d = (const double *)from;
    for (long i = 0; i < rows; i++) for (long j = 0; j < columns; j++) to[j * rows + i] = d[i * wide * WIDTH + j];
}

static void transposed(long rows, long columns, const double *a, double *b)
{
    for (long i = 0; i < rows; i++) for (long j = 0; j < columns; j++) b[j * rows + i] = a[i * columns + j];
}

/* inverse (ny, ny) of the lower root of s; returns the log determinant of s, NaN when it is not positive */
static double inverse_root(long ny, double *s, double *inverse)
{
    double total = 0.0;
    for (long j = 0; j < ny; j++) {
        for (long k = 0; k < j; k++) {
            double f = s[j * ny + k];
            for (long i = j; i < ny; i++) s[i * ny + j] -= f * s[i * ny + k];
        }
        double pivot = s[j * ny + j];
        if (!(pivot > 0.0)) return NAN;
        total += log(pivot);
        pivot = 1.0 / sqrt(pivot);
        for (long i = j; i < ny; i++) s[i * ny + j] *= pivot;
    }
    memset(inverse, 0, ny * ny * sizeof(double));
    for (long i = 0; i < ny; i++) {
        double *row = inverse + i * ny;
        for (long k = 0; k < i; k++) {
            double f = s[i * ny + k];
            for (long j = 0; j <= k; j++) row[j] -= f * inverse[k * ny + j];
        }
        double pivot = 1.0 / s[i * ny + i];
        for (long j = 0; j < i; j++) row[j] *= pivot;
        row[i] = pivot;
    }
    return total;
}

/* A model (nx states) with its coloured disturbances as further states, n = nx + nz: A (n, n), C (ny, n), process
   noise Q over the interval and measurement noise M, as `kalman.augmented`. A part is a sample. */
void augment(long from, long to, long N, long R, long nx, long ny, long nw, long nz, long ni, const long *coloured,
             const long *white, const double *sigma, const double *tau, const double *input, const double *variance,
             const double *dt, const unsigned char *seen, const double *given_A, const double *B0, const double *B1,
             const double *given_C, const double *D, double *A, double *C, double *Q, double *M)
{
    double g[MOST];
    long n = nx + nz;
    for (long at = from * R; at < to * R; at++) {
        const double *d = D + at * ny * nw, *b0 = B0 + at * nx * nw, *b1 = B1 + at * nx * nw;
        double *c = C + at * ny * n, *m = M + at * ny * ny, *a = A + at * n * n, *q = Q + at * n * n;
        memset(m, 0, ny * ny * sizeof(double));
        for (long i = 0; i < ny; i++) {
            memcpy(c + i * n, given_C + (at * ny + i) * nx, nx * sizeof(double));
            for (long z = 0; z < nz; z++) c[i * n + nx + z] = d[i * nw + coloured[z]];
            m[i * ny + i] = seen[at * ny + i] ? variance[i] : 1.0;
        }
        for (long w = 0; w < ni; w++) {
            for (long i = 0; i < ny; i++) g[i] = d[i * nw + white[w]] * input[w];
            for (long i = 0; i < ny; i++) if (g[i] != 0.0) for (long j = 0; j < ny; j++) m[i * ny + j] += g[i] * g[j];
        }
        if (at >= (N - 1) * R) continue;
        memset(a, 0, n * n * sizeof(double));
        memset(q, 0, n * n * sizeof(double));
        for (long i = 0; i < nx; i++) memcpy(a + i * n, given_A + (at * nx + i) * nx, nx * sizeof(double));
        for (long w = 0; w < ni; w++) {
            for (long i = 0; i < nx; i++) g[i] = (b0[i * nw + white[w]] + b1[i * nw + white[w]]) * input[w];
            for (long i = 0; i < nx; i++) if (g[i] != 0.0) for (long j = 0; j < nx; j++) q[i * n + j] += g[i] * g[j];
        }
        for (long z = 0; z < nz; z++) {
            double phi = exp(-dt[at] / tau[z]), driven = sigma[z] * sigma[z] * (1.0 - phi * phi);
            a[(nx + z) * n + nx + z] = phi;
            q[(nx + z) * n + nx + z] = driven;
            for (long i = 0; i < nx; i++) {
                double now = b0[i * nw + coloured[z]], then = b1[i * nw + coloured[z]];
                a[i * n + nx + z] = now + then * phi;
                q[i * n + nx + z] = q[(nx + z) * n + i] = then * driven;
                for (long j = 0; j < nx; j++) q[i * n + j] += then * driven * b1[j * nw + coloured[z]];
            }
        }
    }
}

/* covariance pass; returns 0, or 1 when an innovation's covariance is not positive definite */
int covariance(long from, long to, long N, long R, long n, long ny, const double *A, const double *C, const double *Q,
               const double *M, const double *P0, double *K, double *root, double *kept, double *log_determinant)
{
    V P[MOST * MOST / WIDTH], CP[MOST * MOST / WIDTH], S[MOST * MOST / WIDTH], W[MOST * MOST / WIDTH],
        G[MOST * MOST / WIDTH], T[MOST * MOST / WIDTH];
    double flat[MOST * MOST], root_turned[MOST * MOST];
    long wide = (n + WIDTH - 1) / WIDTH, wide_y = (ny + WIDTH - 1) / WIDTH;
    for (long r = from; r < to; r++) {
        pack(n, n, wide, P0 + r * n * n, P);
        for (long k = 0; k < N; k++) {
            long at = k * R + r;
            const double *c = C + at * ny * n;
            double *inverse = root + at * ny * ny, *gain = K + at * n * ny;
            unpack(n, n, wide, P, kept + at * n * n);
            zero(ny, wide, CP);
            product(ny, n, wide, c, P, CP, 1.0, 0); /* P is symmetric */
            unpack(ny, n, wide, CP, flat);
            pack_turned(ny, n, wide_y, c, T);
            pack(ny, ny, wide_y, M + at * ny * ny, S);
            product(ny, n, wide_y, flat, T, S, 1.0, 0);
            unpack(ny, ny, wide_y, S, flat);
            log_determinant[at] = inverse_root(ny, flat, inverse);
            if (isnan(log_determinant[at])) return 1;
            transposed(ny, ny, inverse, root_turned);
            zero(ny, wide, W);
            product(ny, ny, wide, inverse, CP, W, 1.0, 1);
            zero(ny, wide, G);
            product(ny, ny, wide, root_turned, W, G, 1.0, 0);
            unpack_turned(ny, n, wide, G, gain);
            if (k == N - 1) break;
            unpack_turned(ny, n, wide, W, flat);
            product(n, ny, wide, flat, W, P, -1.0, 0);
            const double *a = A + at * n * n;
            zero(n, wide, G);
            product(n, n, wide, a, P, G, 1.0, 0);
            unpack(n, n, wide, G, flat);
            pack_turned(n, n, wide, flat, T); /* P A' */
            pack(n, n, wide, Q + at * n * n, P);
            product(n, n, wide, a, T, P, 1.0, 0);
            double *p = (double *)P;
            for (long i = 0; i < n; i++) for (long j = 0; j < i; j++)
                p[i * wide * WIDTH + j] = p[j * wide * WIDTH + i] =
                    0.5 * (p[i * wide * WIDTH + j] + p[j * wide * WIDTH + i]);
        }
    }
    return 0;
}

typedef union { V v[2]; double d[TILE]; } tile;

static void load(long rows, long stride, long width, const double *from, tile *to)
{
    for (long i = 0; i < rows; i++) memcpy(to[i].d, from + i * stride, width * sizeof(double));
}

/* to = (added to) what time histories put into `rows` equations through column station[l] of by (rows, nw) */
static void enter(long rows, long nw, long width, const long *station, const double *by, const double *series, tile *to,
                  int add)
{
    for (long i = 0; i < rows; i++) for (int l = 0; l < width; l++) {
        double value = by[i * nw + station[l]] * series[l];
        to[i].d[l] = add ? to[i].d[l] + value : value;
    }
}

/* Innovations of columns: given as Y (N,R,ny,nc), F (N-1,R,nx,nc) and, at the first sample, E0 (R,n,nc), or, when Y is
   null, as time histories series (N,R,nc) that enter at disturbance number station[nc] through Dw, B0, B1.
   white (R,N,ny,nc); states (N,R,n,nc). A part is a tile of columns, of the first record, the second, ... */
void whiten(long from, long to, long N, long R, long n, long nx, long ny, long nc, const double *A, const double *C,
            const double *K, const double *root, const double *Y, const double *F, const double *E0, long nw,
            const long *station, const double *series, const double *Dw, const double *B0, const double *B1,
            double *white, double *states)
{
    tile e[MOST], out[MOST], next[MOST];
    long tiles = (nc + TILE - 1) / TILE;
    tile *all = aligned_alloc(sizeof(tile), tiles * n * sizeof(tile));
    BEGIN
    memset(e, 0, sizeof e); memset(next, 0, sizeof next);
    for (long r = from / tiles; r * tiles < to; r++) {
        long low = from > r * tiles ? from - r * tiles : 0, high = to < (r + 1) * tiles ? to - r * tiles : tiles;
        memset(all, 0, tiles * n * sizeof(tile));
        if (E0) for (long b = low; b < high; b++)
            load(n, nc, nc - b * TILE < TILE ? nc - b * TILE : TILE, E0 + r * n * nc + b * TILE, all + b * n);
        for (long k = 0; k < N; k++) for (long b = low; b < high; b++) {
            long at = k * R + r, first = b * TILE, width = nc - first < TILE ? nc - first : TILE;
            tile *E = all + b * n;
            if (states) for (long i = 0; i < n; i++)
                memcpy(states + (at * n + i) * nc + first, E[i].d, width * sizeof(double));
            if (Y) load(ny, nc, width, Y + at * ny * nc + first, e);
            else enter(ny, nw, width, station + first, Dw + at * ny * nw, series + at * nc + first, e, 0);
            product(ny, n, 2, C + at * ny * n, E->v, e->v, 1.0, 0);
            memset(out, 0, ny * sizeof(tile));
            product(ny, ny, 2, root + at * ny * ny, e->v, out->v, 1.0, 1);
            for (long i = 0; i < ny; i++)
                memcpy(white + ((r * N + k) * ny + i) * nc + first, out[i].d, width * sizeof(double));
            if (k == N - 1) continue;
            if (F) load(nx, nc, width, F + at * nx * nc + first, next);
            else {
                enter(nx, nw, width, station + first, B0 + at * nx * nw, series + at * nc + first, next, 0);
                enter(nx, nw, width, station + first, B1 + at * nx * nw, series + (at + R) * nc + first, next, 1);
            }
            memset(next + nx, 0, (n - nx) * sizeof(tile));
            product(n, ny, 2, K + at * n * ny, e->v, E->v, -1.0, 0);
            product(n, n, 2, A + at * n * n, E->v, next->v, 1.0, 0);
            memcpy(E, next, n * sizeof(tile));
        }
    }
    END
    free(all);
}

/* Bryson-Frazier: deviation (N,R,n) from white (R,N,ny) and predicted states (N,R,n) of one column */
void smooth(long from, long to, long N, long R, long n, long ny, const double *A, const double *C, const double *K,
            const double *root, const double *kept, const double *white, const double *states, double *deviation)
{
    double costate[MOST], moved[MOST], gained[MOST];
    for (long r = from; r < to; r++) {
        memset(costate, 0, sizeof costate);
        for (long k = N - 1; k >= 0; k--) {
            long at = k * R + r;
            const double *c = C + at * ny * n, *gain = K + at * n * ny, *w = white + (r * N + k) * ny;
            if (k < N - 1) {
                const double *a = A + at * n * n;
                memset(moved, 0, sizeof moved);
                for (long i = 0; i < n; i++) for (long j = 0; j < n; j++) moved[j] += a[i * n + j] * costate[i];
                memcpy(costate, moved, n * sizeof(double));
            }
            for (long j = 0; j < ny; j++) {
                double sum = 0.0;
                if (k < N - 1) for (long i = 0; i < n; i++) sum -= gain[i * ny + j] * moved[i];
                for (long i = j; i < ny; i++) sum += root[(at * ny + i) * ny + j] * w[i];
                gained[j] = sum;
            }
            for (long j = 0; j < ny; j++) for (long i = 0; i < n; i++) costate[i] += c[j * n + i] * gained[j];
            for (long i = 0; i < n; i++) {
                double sum = -states[at * n + i];
                for (long j = 0; j < n; j++) sum += kept[(at * n + i) * n + j] * costate[j];
                deviation[at * n + i] = sum;
            }
        }
    }
}

/* moved (nx) = K x0, K (nx, nx) by columns that lie `rows` apart */
static void along(long nx, long rows, const double *K, const double *x0, double *moved)
{
    memset(moved, 0, nx * sizeof(double));
    for (long l = 0; l < nx; l++) {
        double f = x0[l];
        if (f != 0.0) for (long i = 0; i < nx; i++) moved[i] += K[l * rows + i] * f;
    }
}

/* to (ny, columns) = rows of the output equation, 0 where it is not seen */
static void outputs(long nx, long ny, long columns, const double *by, const unsigned char *seen, double *to)
{
    for (long i = 0; i < ny; i++)
        for (long j = 0; j < columns; j++) to[i * columns + j] = seen[i] ? by[j * (nx + ny) + nx + i] : 0.0;
}

/* Step matrices of `innovations.linearise` from Jacobians (N,R,columns,nx+ny) of state and output equations. */
void interval(long from, long to, long N, long R, long nx, long ny, long np, long nw, const double *by_x,
              const double *by_p, const double *by_w, const double *dt, const unsigned char *live,
              const unsigned char *held, const unsigned char *seen, double *A, double *Bp, double *B0, double *B1,
              double *C, double *Dp, double *Dw)
{
    long rows = nx + ny;
    double moved[MOST];
    for (long k = from; k < to; k++) for (long r = 0; r < R; r++) {
        long at = k * R + r, next = at + R;
        const unsigned char *has = seen + at * ny;
        outputs(nx, ny, nx, by_x + at * nx * rows, has, C + at * ny * nx);
        outputs(nx, ny, np, by_p + at * np * rows, has, Dp + at * ny * np);
        outputs(nx, ny, nw, by_w + at * nw * rows, has, Dw + at * ny * nw);
        if (k == N - 1) continue;
        double *a = A + at * nx * nx, *bp = Bp + at * nx * np, *b0 = B0 + at * nx * nw, *b1 = B1 + at * nx * nw;
        if (!live[next]) {
            memset(a, 0, nx * nx * sizeof(double));
            for (long i = 0; i < nx; i++) a[i * nx + i] = 1.0;
            memset(bp, 0, nx * np * sizeof(double));
            memset(b0, 0, nx * nw * sizeof(double));
            memset(b1, 0, nx * nw * sizeof(double));
            continue;
        }
        double h = dt[at];
        const double *K = by_x + next * nx * rows;
        for (long j = 0; j < nx; j++) {
            const double *x0 = by_x + (at * nx + j) * rows, *x1 = K + j * rows;
            along(nx, rows, K, x0, moved);
            for (long i = 0; i < nx; i++) a[i * nx + j] = (i == j) + h / 2 * (x0[i] + x1[i]) + h * h / 2 * moved[i];
        }
        for (long j = 0; j < np; j++) {
            const double *x0 = by_p + (at * np + j) * rows, *x1 = by_p + (next * np + j) * rows;
            along(nx, rows, K, x0, moved);
            for (long i = 0; i < nx; i++) bp[i * np + j] = h / 2 * (x0[i] + x1[i]) + h * h / 2 * moved[i];
        }
        for (long j = 0; j < nw; j++) {
            const double *x0 = by_w + (at * nw + j) * rows, *x1 = by_w + (next * nw + j) * rows;
            along(nx, rows, K, x0, moved);
            for (long i = 0; i < nx; i++) {
                double first = h / 2 * x0[i] + h * h / 3 * moved[i], second = h / 2 * x1[i] + h * h / 6 * moved[i];
                b0[i * nw + j] = held[r] ? first + second : first;
                b1[i * nw + j] = held[r] ? 0.0 : second;
            }
        }
    }
}
"""
