/* The step of a record (casid/estimation/solvers/kkt.py), with the sizes N, F, NF, the vector V and its width W of the
   kernel. Gaussian elimination with partial pivoting, of which the widths are known here. Row i of `a` holds the columns
   from i-BAND on and zeros up to a whole vector. LAPACK's dgbsv, which does the same, spends its time on calls for rows
   this short. */
#define BAND (2 * N - 1)
#define LEFT ((2 * BAND + W) / W) /* vectors from the pivot of a row to its end */
#define ROW (BAND + LEFT * W)
#define SIDES (F + 1)
#define RIGHT ((SIDES + W - 1) / W)
#define UNKNOWNS(count) (N * (2 * (count) - 1))
#if defined(__GNUC__) && !defined(__clang__)
#define UNROLLED __attribute__((optimize("O3"))) /* at -O2 gcc keeps the short loops over vectors as loops */
#else
#define UNROLLED
#endif
typedef double U __attribute__((vector_size(8 * W), aligned(8), may_alias)); /* a vector that starts anywhere */

/* doubles of work space that `reduce` needs */
long work(long count) { return UNKNOWNS(count) * (ROW + RIGHT * W); }

static inline void exchange(double *a, double *b, int vectors)
{
    for (int v = 0; v < vectors; v++) {
        U held = ((U *)a)[v];
        ((U *)a)[v] = ((U *)b)[v];
        ((U *)b)[v] = held;
    }
}

UNROLLED static int solve_banded(long size, double *a, U (*b)[RIGHT])
{
    for (long j = 0; j < size; j++) {
        const long last = j + BAND < size ? j + BAND : size - 1;
        double *top = a + j * ROW + BAND;
        long pivot = j;
        double largest = fabs(top[0]);
        for (long r = j + 1; r <= last; r++) {
            const double entry = fabs(a[r * ROW + BAND + j - r]);
            pivot = entry > largest ? r : pivot;
            largest = entry > largest ? entry : largest;
        }
        double *row = a + pivot * ROW + BAND + j - pivot;
        if (!(fabs(row[0]) > 0.0)) return 1;
        if (pivot != j) {
            exchange(top, row, LEFT);
            exchange((double *)b[j], (double *)b[pivot], RIGHT);
        }
        const double inverse = 1.0 / top[0];
        for (long r = j + 1; r <= last; r++) {
            double *below = a + r * ROW + BAND + j - r;
            if (below[0] == 0.0) continue;
            const U factor = (U){0} + below[0] * inverse;
            for (int v = 0; v < LEFT; v++) ((U *)below)[v] -= factor * ((U *)top)[v];
            for (int v = 0; v < RIGHT; v++) b[r][v] -= factor * b[j][v];
        }
    }
    for (long j = size - 1; j >= 0; j--) {
        const double *top = a + j * ROW + BAND;
        const long last = 2 * BAND + 1 < size - j ? 2 * BAND + 1 : size - j;
        U odd[RIGHT], even[RIGHT]; /* two chains of sums, which need not wait for each other */
        for (int v = 0; v < RIGHT; v++) odd[v] = b[j][v], even[v] = (U){0};
        for (long k = 1; k + 1 < last; k += 2)
            for (int v = 0; v < RIGHT; v++) odd[v] -= top[k] * b[j + k][v], even[v] += top[k + 1] * b[j + k + 1][v];
        if (last % 2 == 0)
            for (int v = 0; v < RIGHT; v++) odd[v] -= top[last - 1] * b[j + last - 1][v];
        const double inverse = 1.0 / top[0];
        for (int v = 0; v < RIGHT; v++) b[j][v] = (odd[v] - even[v]) * inverse;
    }
    return 0;
}

/* hessian (count, NF, NF), gradient (count, NF), transition (count, N, NF), defect (count-1, N), covariance
   (count-1, N, N) or NULL, scale (N); states (count, N, SIDES), multipliers (count-1, N, SIDES),
   information (F, SIDES): its column 0 is minus the gradient. 1 when the system is singular. */
UNROLLED
int reduce(long count, const double *hessian, const double *gradient, const double *transition, const double *defect,
           const double *covariance, const double *scale, double *space, double *states,
           double *multipliers, double *information)
{
    const long size = UNKNOWNS(count);
    U (*b)[RIGHT] = (U (*)[RIGHT])space;
    double *a = space + size * RIGHT * W;
    memset(space, 0, work(count) * sizeof(double));
    double so = 0.0; /* scales the cost: mean of the largest scaled curvatures of the nodes */
    for (long k = 0; k < count; k++) {
        double largest = 0.0;
        for (int i = 0; i < N; i++) {
            const double own = hessian[(k * NF + i) * NF + i] * scale[i] * scale[i];
            largest = own > largest ? own : largest;
        }
        so += largest;
    }
    so = count / (so > 1e-300 ? so : 1e-300);
    for (long k = 0; k < count; k++) {
        const double *h = hessian + k * NF * NF, *g = gradient + k * NF, *t = transition + k * N * NF;
        for (long i = 0, row = 2 * N * k; i < N; i++, row++) {
            double *left = a + row * ROW + BAND - row + 2 * N * k, *right = (double *)b[row]; /* left: from s_k on */
            const double si = so * scale[i];
            for (int c = 0; c < N; c++) left[c] = h[i * NF + c] * si * scale[c];
            if (k + 1 < count)
                for (int c = 0; c < N; c++) left[N + c] = -t[c * NF + i] * (scale[i] / scale[c]);
            if (k > 0) left[i - N] = 1.0;
            right[0] = -g[i] * si;
            for (int c = 0; c < F; c++) right[1 + c] = h[i * NF + N + c] * si;
        }
        if (k + 1 == count) break;
        for (long i = 0, row = 2 * N * k + N; i < N; i++, row++) {
            double *left = a + row * ROW + BAND - row + 2 * N * k, *right = (double *)b[row];
            for (int c = 0; c < N; c++) left[c] = -t[i * NF + c] * (scale[c] / scale[i]);
            if (covariance)
                for (int c = 0; c < N; c++) left[N + c] = -covariance[(k * N + i) * N + c] / (so * scale[i] * scale[c]);
            left[2 * N + i] = 1.0;
            right[0] = defect[k * N + i] / scale[i];
            for (int c = 0; c < F; c++) right[1 + c] = -t[i * NF + N + c] / scale[i];
        }
    }
    if (solve_banded(size, a, b)) return 1;
    U sum[F][RIGHT];
    memset(sum, 0, sizeof sum);
    for (long k = 0; k < count; k++) {
        const double *h = hessian + k * NF * NF, *g = gradient + k * NF, *t = transition + k * N * NF;
        for (int f = 0; f < F; f++) {
            double *own = (double *)sum[f];
            own[0] -= g[N + f];
            for (int c = 0; c < F; c++) own[1 + c] += h[(N + f) * NF + N + c];
        }
        for (int i = 0; i < N; i++) {
            U *x = b[2 * N * k + i];
            for (int v = 0; v < RIGHT; v++) x[v] *= scale[i];
            memcpy(states + (k * N + i) * SIDES, x, SIDES * sizeof(double));
            for (int f = 0; f < F; f++)
                for (int v = 0; v < RIGHT; v++) sum[f][v] -= h[i * NF + N + f] * x[v];
            if (k + 1 == count) continue;
            U *l = b[2 * N * k + N + i];
            for (int v = 0; v < RIGHT; v++) l[v] *= 1.0 / (so * scale[i]);
            memcpy(multipliers + (k * N + i) * SIDES, l, SIDES * sizeof(double));
            for (int f = 0; f < F; f++)
                for (int v = 0; v < RIGHT; v++) sum[f][v] += t[i * NF + N + f] * l[v];
        }
    }
    for (int f = 0; f < F; f++) memcpy(information + f * SIDES, sum[f], SIDES * sizeof(double));
    return 0;
}
