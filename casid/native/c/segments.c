/* Simulate segments, or linearise them and gather their Gram blocks on the way; kernel_source.py writes what goes
   before: sizes, the functions of the model, and the rows of its matrices. */
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
                V r = where(out[i] - d[2 * M + 1 + i], present[i]);
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

#define TILE 4
#define FIRST_CACHE (48 * 1024) /* bytes */
/* entries (c, d) of the lower triangle by rows; a q that does not stay in the first cache is read in tiles */
static inline void accumulate(V *restrict H, V (*restrict g)[NF], V (*restrict q)[NF], const V *r)
{
    for (int i = 0; i < O; i++)
        for (int c = 0; c < NF; c++) g[i][c] += q[i][c] * r[i];
#if O * NF * W * 8 <= FIRST_CACHE
    for (int c = 0; c < NF; c++)
        for (int d = 0; d <= c; d++) {
            V h = *H;
            for (int i = 0; i < O; i++) h += q[i][c] * q[i][d];
            *H++ = h;
        }
#else
    for (int c = 0; c < NF; c += TILE)
        for (int d = 0; d <= c; d += TILE) {
            if (d < c && c + TILE <= NF) {
                V *row[TILE], h[TILE][TILE];
                for (int a = 0; a < TILE; a++) {
                    row[a] = H + (c + a) * (c + a + 1) / 2 + d;
                    for (int b = 0; b < TILE; b++) h[a][b] = row[a][b];
                }
                for (int i = 0; i < O; i++)
                    for (int a = 0; a < TILE; a++)
                        for (int b = 0; b < TILE; b++) h[a][b] += q[i][c + a] * q[i][d + b];
                for (int a = 0; a < TILE; a++)
                    for (int b = 0; b < TILE; b++) row[a][b] = h[a][b];
                continue;
            }
            for (int a = c; a < c + TILE && a < NF; a++)
                for (int b = d; b < d + TILE && b <= a; b++)
                    for (int i = 0; i < O; i++) H[a * (a + 1) / 2 + b] += q[i][a] * q[i][b];
        }
#endif
}

/* whether a lane has a row of zeros in the triangle L: what is not measured */
static inline int lacking(const V *L)
{
    int any = 0;
    for (int i = 0; i < O; i++)
        for (int l = 0; l < W; l++) any |= L[i * (i + 3) / 2][l] == 0.0;
    return any;
}

static inline void drop_unmeasured(V (*restrict q)[NF], V *restrict r, const V *restrict L)
{
    for (int i = 0; i < O; i++) {
        const V on = L[i * (i + 3) / 2];
        r[i] = where(r[i], on);
        for (int c = 0; c < NF; c++) q[i][c] = where(q[i][c], on);
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
        V drive[F + NV + 1][STAGE_COUNT][DRIVEN];
        V L[TRIANGLE], held = (V){0} - 1.0;
        int lacks = 0;
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
            drives(drive, DRIVES);
            outputs(q, C, D, S);
            if (choose(L, &held, d + PATTERN, weights, TRIANGLE)) lacks = lacking(L);
            for (int i = 0; i < O; i++) r[i] = out[i] - d[2 * M + 1 + i];
            if (lacks) drop_unmeasured(q, r, L);
            whiten(q, r, L, dense);
            if (rows) scatter(rows, q[0], O * NF, k, length, first, count);
            accumulate(H, g, q, r);
            for (int c = 0; c < N; c++) homogeneous(S[c], 0, d[2 * M], FACTORS);
            for (int c = 0; c < F; c++) driven(S[N + c], drive[c], d[2 * M], FACTORS);
#if NV
            spread(P, drive, d[2 * M], intensity, FACTORS);
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
