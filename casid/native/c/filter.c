/* The recursions of the Kalman filter (casid/filtering/kernel.py); the numpy versions in casid/filtering/kalman.py say
   what they compute. Every function runs the parts `from` to `to` of its work: records, samples or tiles of columns.
   MOST, the largest number of states or outputs, and TILE, the columns that go through the filter side by side, are
   defined when it is compiled. */
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

/* rows of vectors: c (height, 1 or 2 of `wide`) += a (height, the first `most`) b (most, the same), or -=. In a, `down`
   lies between rows and `along` between columns: the transposed of what is stored in rows of `along` when `down` is 1. */
static inline __attribute__((always_inline)) void block(int height, int two, long most, long down, long along, long wide,
                                                        const double *a, const V *b, V *c, int minus)
{
    V s[6], t[6];
    for (int i = 0; i < height; i++) {
        s[i] = c[i * wide];
        if (two) t[i] = c[i * wide + 1];
    }
    for (long j = 0; j < most; j++) {
        V x = b[j * wide], y = two ? b[j * wide + 1] : x;
        for (int i = 0; i < height; i++) {
            double f = a[i * down + j * along];
            if (minus) { s[i] -= f * x; if (two) t[i] -= f * y; }
            else { s[i] += f * x; if (two) t[i] += f * y; }
        }
    }
    for (int i = 0; i < height; i++) {
        c[i * wide] = s[i];
        if (two) c[i * wide + 1] = t[i];
    }
}

/* `block` of up to six rows, whose sums do not wait for each other */
static inline __attribute__((always_inline)) void rows_of(long height, int two, long most, long down, long along,
                                                          long wide, const double *a, const V *b, V *c, int minus)
{
    switch (height) {
    case 6: block(6, two, most, down, along, wide, a, b, c, minus); break;
    case 5: block(5, two, most, down, along, wide, a, b, c, minus); break;
    case 4: block(4, two, most, down, along, wide, a, b, c, minus); break;
    case 3: block(3, two, most, down, along, wide, a, b, c, minus); break;
    case 2: block(2, two, most, down, along, wide, a, b, c, minus); break;
    default: block(1, two, most, down, along, wide, a, b, c, minus);
    }
}

/* c (rows, wide) += a (rows, inner) b (inner, wide), or -=, b and c in rows of `wide` vectors; of a lower triangle a
   only what is not zero when `triangle` is set. Four to six rows at a time, so that what is read of b serves them all. */
static void product(long rows, long inner, long down, long along, long wide, const double *a, const V *b, V *c,
                    int minus, int triangle)
{
    for (long v = 0; v < wide; v += 2) for (long i = 0, height; i < rows; i += height) {
        height = rows - i <= 6 ? rows - i : rows - i <= 8 ? 4 : rows - i == 9 ? 5 : 6; /* few are left over */
        long most = triangle ? i + height : inner;
        const double *from = a + i * down;
        if (v + 1 < wide && minus) rows_of(height, 1, most, down, along, wide, from, b + v, c + i * wide + v, 1);
        else if (v + 1 < wide) rows_of(height, 1, most, down, along, wide, from, b + v, c + i * wide + v, 0);
        else if (minus) rows_of(height, 0, most, down, along, wide, from, b + v, c + i * wide + v, 1);
        else rows_of(height, 0, most, down, along, wide, from, b + v, c + i * wide + v, 0);
    }
}

static void zero(long rows, long wide, V *to) { memset(to, 0, rows * wide * sizeof(V)); }

/* Matrix number `at` of many, or a row, is needed soon (or never, where there is none): into the second cache, for what
   is fetched into the first holds up what follows. */
static inline void fetch(const double *matrices, long at, long size)
{
    for (long i = 0; i < size; i += 8) __builtin_prefetch(matrices + at * size + i, 0, 2);
}

/* numbers of a row: no call of a function for the few that they are */
static inline __attribute__((always_inline)) void copy(double *to, const double *from, long width)
{
    long i = 0;
    for (; i + 8 <= width; i += 8) memcpy(to + i, from + i, 8 * sizeof(double));
    if (i + 4 <= width) { memcpy(to + i, from + i, 4 * sizeof(double)); i += 4; }
    for (; i < width; i++) to[i] = from[i];
}

/* rows of two vectors: c (rows) += a' b (inner), or -=, of the first `rows` columns of a (inner, stride); of a lower
   triangle a only what is not zero */
static inline __attribute__((always_inline)) void product_turned(long rows, long inner, long stride, const double *a,
                                                                 const V *b, V *c, int minus, int triangle)
{
    long i = 0;
    for (; i + 6 <= rows; i += 6) {
        long j = triangle ? i : 0;
        block(6, 1, inner - j, 1, stride, 2, a + j * stride + i, b + 2 * j, c + 2 * i, minus);
    }
    for (; i + 3 <= rows; i += 3) {
        long j = triangle ? i : 0;
        block(3, 1, inner - j, 1, stride, 2, a + j * stride + i, b + 2 * j, c + 2 * i, minus);
    }
    for (; i < rows; i++) {
        long j = triangle ? i : 0;
        block(1, 1, inner - j, 1, stride, 2, a + j * stride + i, b + 2 * j, c + 2 * i, minus);
    }
}

/* rows of doubles to rows of vectors, and back; turned: of the transposed. What is behind the columns stays. */
static inline void pack(long rows, long columns, long wide, const double *from, V *to)
{
    for (long i = 0; i < rows; i++) copy((double *)(to + i * wide), from + i * columns, columns);
}

static inline void pack_turned(long rows, long columns, long wide, const double *from, V *to)
{
    double *d = (double *)to;
    for (long i = 0; i < rows; i++) for (long j = 0; j < columns; j++) d[j * wide * WIDTH + i] = from[i * columns + j];
}

static inline void unpack(long rows, long columns, long wide, const V *from, double *to)
{
    for (long i = 0; i < rows; i++) copy(to + i * columns, (const double *)(from + i * wide), columns);
}

/* S (ny rows of wide_y vectors), positive definite, becomes the inverse of its lower root; G (ny rows of `wide`) that
   inverse times itself. By elimination in whole rows, in place. Returns the log determinant of S, NaN when it is not
   positive definite. */
static double inverse_root(long ny, long wide_y, long wide, V *S, V *G)
{
    double total = 0.0, product = 1.0, *s = (double *)S, pivots[MOST];
    for (long j = 0; j < ny; j++) {
        double pivot = s[j * wide_y * WIDTH + j], by = 1.0 / pivot;
        if (!(pivot > 0.0)) return NAN;
        pivots[j] = pivot;
        product *= pivot; /* a logarithm of many */
        if (!(product > 1e-100 && product < 1e100)) { total += log(product); product = 1.0; }
        for (long i = j + 1; i < ny; i++) {
            double f = s[i * wide_y * WIDTH + j] * by;
            for (long v = 0; v < wide_y; v++) S[i * wide_y + v] -= f * S[j * wide_y + v];
            for (long v = 0; v < wide; v++) G[i * wide + v] -= f * G[j * wide + v];
            s[i * wide_y * WIDTH + j] = -f; /* of the inverse, in the place of what has become zero */
        }
    }
    for (long j = 0; j < ny; j++) {
        double scale = 1.0 / sqrt(pivots[j]);
        s[j * wide_y * WIDTH + j] = 1.0;
        for (long i = j + 1; i < ny; i++) s[j * wide_y * WIDTH + i] = 0.0;
        for (long v = 0; v < wide_y; v++) S[j * wide_y + v] *= scale;
        for (long v = 0; v < wide; v++) G[j * wide + v] *= scale;
    }
    return total + log(product);
}

typedef double Q __attribute__((vector_size(32))); /* for one column: rows of ten or twenty leave few over */

static inline Q four(const double *from) { Q q; memcpy(&q, from, sizeof q); return q; }

/* the sum of each of four vectors, in two halves that shuffle well */
static inline __attribute__((always_inline)) Q sums(Q s, Q t, Q u, Q v)
{
    Q a = (Q){s[0], t[0], s[2], t[2]} + (Q){s[1], t[1], s[3], t[3]};
    Q b = (Q){u[0], v[0], u[2], v[2]} + (Q){u[1], v[1], u[3], v[3]};
    return (Q){a[0], a[1], b[0], b[1]} + (Q){a[2], a[3], b[2], b[3]};
}

/* to (rows) = start (zero where it is null) + or - a (rows, inner) b, one column; of a lower triangle a only what is
   not zero. Four rows and four columns at a time. The last four begin earlier, as nothing behind a matrix may be read:
   such rows are done twice alike, such columns count once. */
static inline __attribute__((always_inline)) void product_one(long rows, long inner, const double *a, const double *b,
                                                              const double *start, double sign, double *to,
                                                              int triangle)
{
    static const double once[8] = {0, 0, 0, 0, 1, 1, 1, 1};
    if (rows < 4 || inner < 4) {
        for (long i = 0; i < rows; i++) {
            double sum = 0.0;
            for (long j = 0; j < inner; j++) sum += a[i * inner + j] * b[j];
            to[i] = (start ? start[i] : 0.0) + sign * sum;
        }
        return;
    }
    Q rest = four(b + inner - 4) * four(once + inner % 4);
    for (long done = 0; done < rows; done += 4) {
        long i = done + 4 <= rows ? done : rows - 4, most = triangle ? i + 4 : inner, j = 0;
        const double *r = a + i * inner;
        Q s = {0}, t = s, u = s, v = s;
        for (; j + 4 <= most; j += 4) {
            Q x = four(b + j);
            s += four(r + j) * x; t += four(r + inner + j) * x;
            u += four(r + 2 * inner + j) * x; v += four(r + 3 * inner + j) * x;
        }
        if (j < most) {
            r += inner - 4;
            s += four(r) * rest; t += four(r + inner) * rest;
            u += four(r + 2 * inner) * rest; v += four(r + 3 * inner) * rest;
        }
        s = sign * sums(s, t, u, v);
        if (start) s += four(start + i);
        memcpy(to + i, &s, sizeof s);
    }
}

/* the same of the transposed of a (rows, columns), 4 `many` columns from number j on; rows backwards, as samples go */
static inline __attribute__((always_inline)) void turned_columns(int many, long j, long rows, long columns,
                                                                 const double *a, const double *b, const double *start,
                                                                 double sign, double *to)
{
    long at[6];
    Q s[6] = {0};
    for (int l = 0; l < many; l++) at[l] = j + 4 * l + 4 <= columns ? j + 4 * l : columns - 4;
    for (long i = rows - 1; i >= 0; i--) for (int l = 0; l < many; l++) s[l] += b[i] * four(a + i * columns + at[l]);
    for (int l = 0; l < many; l++) {
        s[l] *= sign;
        if (start) s[l] += four(start + at[l]);
        memcpy(to + at[l], s + l, sizeof(Q));
    }
}

/* of all columns: in one pass if possible, as memory is read fast in one direction only */
static inline __attribute__((always_inline)) void turned_one(long rows, long columns, const double *a, const double *b,
                                                             const double *start, double sign, double *to)
{
    if (columns < 4) {
        for (long j = 0; j < columns; j++) {
            double sum = 0.0;
            for (long i = 0; i < rows; i++) sum += a[i * columns + j] * b[i];
            to[j] = (start ? start[j] : 0.0) + sign * sum;
        }
        return;
    }
    for (long j = 0; j < columns; j += 24)
        if (columns - j <= 16) turned_columns(4, j, rows, columns, a, b, start, sign, to);
        else turned_columns(6, j, rows, columns, a, b, start, sign, to);
}

/* columns `index` of by (rows, nw) times `factor`, by column, added to a matrix in rows of `wide` vectors, from column
   `first` on */
static inline void add_columns(long rows, long nw, const double *by, long count, const long *index, const double *factor,
                               long wide, double *to)
{
    for (long i = 0; i < rows; i++)
        for (long w = 0; w < count; w++) to[i * wide * WIDTH + w] += by[i * nw + index[w]] * factor[w];
}

/* A model (nx states) with its coloured disturbances as further states, n = nx + nz: A (n, n), C (ny, n), process
   noise Q over the interval, measurement noise M and what both share S (n, ny), as `kalman.augmented`. G (nx rows) and
   F (ny rows) are what unit noises put into states and readings: recorded inputs first, whose noise at a sample has
   entered over the interval before too, then white disturbances, then news of the coloured ones. A part is a sample. */
void augment(long from, long to, long N, long R, long nx, long ny, long nw, long nz, long nv, long ni,
             const long *coloured, const long *white, const long *input, const double *sigma, const double *tau,
             const double *white_sigma, const double *input_sigma, const double *variance, const double *dt,
             const unsigned char *seen, const double *given_A, const double *B0, const double *B1,
             const double *given_C, const double *D, double *A, double *C, double *Q, double *M, double *S)
{
    long n = nx + nz, many = ni + nv + nz, wide_m = (many + WIDTH - 1) / WIDTH, wide = (n + WIDTH - 1) / WIDTH;
    long wide_y = (ny + WIDTH - 1) / WIDTH, stride = wide_m * WIDTH, size = (2 * nx + ny) * wide_m + 2 * n * (wide + wide_y);
    V *X = aligned_alloc(sizeof(V), (size + (stride + ny) * (wide + wide_y)) * sizeof(V)), *G = X + nx * wide_m;
    V *F = G + nx * wide_m, *made = F + ny * wide_m, *turned_G = made + 2 * n * (wide + wide_y);
    V *turned_F = turned_G + stride * wide, *measured = turned_F + stride * wide_y;
    double *x = (double *)X, *g = (double *)G, *f = (double *)F, *m = (double *)measured, *q = (double *)made;
    double phi[MOST], driven[MOST], root[MOST], step = -1.0;
    zero(stride, wide + wide_y, turned_G);
    for (long at = from * R; at < to * R; at++) {
        const double *d = D + at * ny * nw, *b0 = B0 + at * nx * nw, *b1 = B1 + at * nx * nw;
        double *c = C + at * ny * n, *a = A + at * n * n;
        int first = at < R, last = at >= (N - 1) * R;
        for (long i = 0; i < ny; i++) {
            memcpy(c + i * n, given_C + (at * ny + i) * nx, nx * sizeof(double));
            for (long z = 0; z < nz; z++) c[i * n + nx + z] = d[i * nw + coloured[z]];
        }
        zero(nx, wide_m, X);
        zero(nx + ny, wide_m, G);
        if (!first) add_columns(nx, nw, b1 - R * nx * nw, ni, input, input_sigma, wide_m, x);
        product(ny, nx, nx, 1, wide_m, given_C + at * ny * nx, X, F, 0, 0);
        add_columns(ny, nw, d, ni, input, input_sigma, wide_m, f);
        add_columns(ny, nw, d, nv, white, white_sigma, wide_m, f + ni);
        pack_turned(ny, stride, wide_y, f, turned_F);
        zero(ny, wide_y, measured);
        product(ny, ni + nv, stride, 1, wide_y, f, turned_F, measured, 0, 0);
        for (long i = 0; i < ny; i++) m[i * wide_y * WIDTH + i] += seen[at * ny + i] ? variance[i] : 1.0;
        unpack(ny, ny, wide_y, measured, M + at * ny * ny);
        if (last) continue;
        if (dt[at] != step) for (long z = 0; z < nz; z++) {
            phi[z] = exp(-dt[at] / tau[z]);
            driven[z] = sigma[z] * sigma[z] * (1.0 - phi[z] * phi[z]);
            root[z] = sqrt(driven[z]);
        }
        step = dt[at];
        product(nx, nx, nx, 1, wide_m, given_A + at * nx * nx, X, G, 0, 0);
        add_columns(nx, nw, b0, ni, input, input_sigma, wide_m, g);
        add_columns(nx, nw, b0, nv, white, white_sigma, wide_m, g + ni);
        add_columns(nx, nw, b1, nv, white, white_sigma, wide_m, g + ni);
        zero(n, wide_y, made);
        product(nx, ni, stride, 1, wide_y, g, turned_F, made, 0, 0);
        unpack(n, ny, wide_y, made, S + at * n * ny);
        add_columns(nx, nw, b1, nz, coloured, root, wide_m, g + ni + nv);
        pack_turned(nx, stride, wide, g, turned_G);
        zero(n, wide, made);
        product(nx, many, stride, 1, wide, g, turned_G, made, 0, 0);
        memset(a, 0, n * n * sizeof(double));
        for (long i = 0; i < nx; i++) memcpy(a + i * n, given_A + (at * nx + i) * nx, nx * sizeof(double));
        for (long z = 0; z < nz; z++) {
            a[(nx + z) * n + nx + z] = phi[z];
            q[(nx + z) * wide * WIDTH + nx + z] = driven[z];
            for (long i = 0; i < nx; i++) {
                double now = b0[i * nw + coloured[z]], then = b1[i * nw + coloured[z]];
                a[i * n + nx + z] = now + then * phi[z];
                q[i * wide * WIDTH + nx + z] = q[(nx + z) * wide * WIDTH + i] = then * driven[z];
            }
        }
        unpack(n, n, wide, made, Q + at * n * n);
    }
    free(X);
}

/* covariance pass, all records of a sample before the next; returns 0, or 1 when an innovation's covariance is not
   positive definite */
int covariance(long from, long to, long N, long R, long n, long ny, const double *A, const double *C, const double *Q,
               const double *M, const double *shared, const double *P0, double *gain, double *root, double *kept,
               double *log_determinant)
{
    long wide = (n + WIDTH - 1) / WIDTH, wide_y = (ny + WIDTH - 1) / WIDTH, w = wide * WIDTH;
    long all = n * wide, records = to - from, size = records * all + (3 * n + 2 * ny) * (wide + wide_y);
    V *held = aligned_alloc(sizeof(V), size * sizeof(V)), *AP = held + records * all, *turned = AP + all;
    V *turned_C = turned + all, *K = turned_C + n * wide_y;
    V *CP = K + n * wide_y, *G = CP + ny * wide, *S = G + ny * wide;
    int failed = 0;
    zero(size, 1, held);
    for (long r = from; r < to; r++) pack(n, n, wide, P0 + r * n * n, held + (r - from) * all);
    for (long k = 0; k < N && !failed; k++) {
        for (long r = from; r < to; r++) {
            long at = k * R + r;
            const double *c = C + at * ny * n, *a = A + at * n * n, *q = Q + at * n * n;
            V *P = held + (r - from) * all;
            int last = k == N - 1;
            unpack(n, n, wide, P, kept + at * n * n);
            zero(ny, wide, CP);
            product(ny, n, n, 1, wide, c, P, CP, 0, 0); /* P is symmetric */
            pack_turned(ny, n, wide_y, c, turned_C);
            pack(ny, ny, wide_y, M + at * ny * ny, S);
            product(ny, n, w, 1, wide_y, (double *)CP, turned_C, S, 0, 0);
            zero(ny, wide, G);
            if (!last) { /* C P A' + what is shared */
                pack_turned(n, n, wide, a, turned);
                if (shared) pack_turned(n, ny, wide, shared + at * n * ny, G);
                product(ny, n, w, 1, wide, (double *)CP, turned, G, 0, 0);
            }
            log_determinant[at] = inverse_root(ny, wide_y, wide, S, G);
            unpack(ny, ny, wide_y, S, root + at * ny * ny);
            if (isnan(log_determinant[at])) { failed = 1; break; }
            if (last) continue;
            zero(n, wide_y, K);
            product(n, ny, 1, w, wide_y, (double *)G, S, K, 0, 0);
            unpack(n, ny, wide_y, K, gain + at * n * ny);
            zero(n, wide, AP);
            product(n, n, n, 1, wide, a, P, AP, 0, 0);
            pack(n, n, wide, q, P);
            product(n, n, w, 1, wide, (double *)AP, turned, P, 0, 0);
            product(n, ny, 1, w, wide, (double *)G, G, P, 1, 0);
            double *p = (double *)P;
            for (long i = 0; i < n; i++) for (long j = 0; j < i; j++)
                p[i * w + j] = p[j * w + i] = 0.5 * (p[i * w + j] + p[j * w + i]);
        }
    }
    free(held);
    return failed;
}

typedef union { V v[2]; double d[TILE]; } tile;

/* `whiten` of one column; a part is a record. All records of a sample are done before the next, as they lie in memory.
   Unless it is null, `states` (N,R,n) are those at every sample. */
void whiten_one(long from, long to, long N, long R, long n, long nx, long ny, const double *A, const double *C,
                const double *gain, const double *root, const double *Y, const double *F, double *held, long steps,
                long of_record, long of_row, double *white, double *states)
{
    double e[MOST], out[MOST], forced[MOST] = {0}, next[MOST], *all = calloc((to - from) * n, sizeof(double));
    BEGIN
    if (held) memcpy(all, held + from * n, (to - from) * n * sizeof(double));
    for (long k = 0; k < N; k++) for (long r = from; r < to; r++) {
        long at = k * R + r;
        double *E = all + (r - from) * n;
        if (states) copy(states + at * n, E, n);
        product_one(ny, n, C + at * ny * n, E, Y + at * ny, 1.0, e, 0);
        product_one(ny, ny, root + at * ny * ny, e, 0, 1.0, out, 1);
        for (long i = 0; i < ny; i++) white[r * of_record + (k * ny + i) * of_row] = out[i];
        if (k == steps) continue;
        copy(forced, F + at * nx, nx);
        product_one(n, ny, gain + at * n * ny, e, forced, -1.0, next, 0);
        product_one(n, n, A + at * n * n, E, next, 1.0, e, 0);
        copy(E, e, n);
    }
    if (held) memcpy(held + from * n, all, (to - from) * n * sizeof(double));
    END
    free(all);
}

/* The transposed of `whiten`: of columns of innovations white (R,N,ny,nc) what a unit at a sample would have in common
   with them. entering (ns,R,N,nc): of a time history at each of ns disturbances `station`, which are among the `among`
   from number `low` on; read (ny,R,N,nc), or null: of each output. A part is a tile of columns, of the first record, the
   second, ...; all are done before the sample before, strictly backwards as they lie in memory. */
void entrances(long from, long to, long N, long R, long n, long nx, long ny, long nc, const double *A, const double *C,
               const double *gain, const double *root, const double *white, long nw, long low, long among, long ns,
               const long *station, const double *Dw, const double *B0, const double *B1, double *entering, double *read)
{
    tile w[MOST], u[MOST], next[MOST];
    long tiles = (nc + TILE - 1) / TILE, size = (to - from) * n;
    tile *costates = aligned_alloc(sizeof(tile), (size + among) * sizeof(tile)), *sums = costates + size;
    BEGIN
    memset(costates, 0, size * sizeof(tile));
    memset(w, 0, sizeof w);
    for (long k = N - 1; k >= 0; k--) for (long part = to - 1; part >= from; part--) {
        long r = part / tiles, first = part % tiles * TILE, width = nc - first < TILE ? nc - first : TILE, at = k * R + r;
        tile *costate = costates + (part - from) * n;
        if (part % tiles == 0) {
            fetch(root, at - 2, ny * ny); fetch(gain, at - 2, n * ny); fetch(A, at - 2, n * n); fetch(C, at - 2, ny * n);
            fetch(B0, at - 2, nx * nw); fetch(B1, at - R - 2, nx * nw); fetch(Dw, at - 2, ny * nw);
            fetch(white, r * N + k - 1, ny * nc);
        }
        for (long i = 0; i < ny; i++) copy(w[i].d, white + ((r * N + k) * ny + i) * nc + first, width);
        memset(u, 0, ny * sizeof(tile));
        memset(next, 0, n * sizeof(tile));
        memset(sums, 0, among * sizeof(tile));
        product_turned(ny, ny, ny, root + at * ny * ny, w->v, u->v, 0, 1);
        if (k < N - 1) {
            product_turned(ny, n, ny, gain + at * n * ny, costate->v, u->v, 1, 0);
            product_turned(n, n, n, A + at * n * n, costate->v, next->v, 0, 0);
            product_turned(among, nx, nw, B0 + at * nx * nw + low, costate->v, sums->v, 0, 0);
        }
        product_turned(n, ny, n, C + at * ny * n, u->v, next->v, 0, 0);
        product_turned(among, ny, nw, Dw + at * ny * nw + low, u->v, sums->v, 0, 0);
        if (k) product_turned(among, nx, nw, B1 + (at - R) * nx * nw + low, next->v, sums->v, 0, 0);
        for (long s = 0; s < ns; s++) {
            copy(entering + ((s * R + r) * N + k) * nc + first, sums[station[s] - low].d, width);
            fetch(entering + first, (s * R + r) * N + k - 1, nc);
        }
        for (long i = 0; i < ny && read; i++) {
            copy(read + ((i * R + r) * N + k) * nc + first, u[i].d, width);
            fetch(read + first, (i * R + r) * N + k - 1, nc);
        }
        memcpy(costate, next, n * sizeof(tile));
    }
    END
    free(costates);
}

/* Bryson-Frazier, from white (R,N,ny) of one column: costates (N,R,n) of the predicted states, and what a unit at a
   sample of each of ns disturbances `station` would have in common with it: entering (N,R,ns), as of `entrances` */
void costates(long from, long to, long N, long R, long n, long ny, const double *A, const double *C, const double *gain,
              const double *root, const double *white, long nx, long nw, long ns, const long *station, const double *Dw,
              const double *B0, const double *B1, double *found, double *entering)
{
    double pulled[MOST], pull[MOST], moved[MOST], none[MOST] = {0};
    double *through = malloc(2 * nw * sizeof(double)), *more = through + nw;
    BEGIN
    for (long k = N - 1; k >= 0; k--) for (long r = to - 1; r >= from; r--) {
        long at = k * R + r, last = k == N - 1;
        const double *after = last ? none : found + (at + R) * n;
        double *costate = found + at * n;
        turned_one(ny, ny, root + at * ny * ny, white + (r * N + k) * ny, 0, 1.0, pulled);
        turned_one(last ? 0 : n, ny, gain + at * n * ny, after, pulled, -1.0, pull);
        turned_one(last ? 0 : n, n, A + at * n * n, after, 0, 1.0, moved);
        turned_one(ny, n, C + at * ny * n, pull, moved, 1.0, costate);
        if (!ns) continue;
        turned_one(last ? 0 : nx, nw, B0 + at * nx * nw, after, 0, 1.0, through);
        turned_one(ny, nw, Dw + at * ny * nw, pull, through, 1.0, more);
        turned_one(k ? nx : 0, nw, B1 + (at - R) * nx * nw, costate, more, 1.0, through);
        for (long s = 0; s < ns; s++) entering[at * ns + s] = through[station[s]];
    }
    END
    free(through);
}
