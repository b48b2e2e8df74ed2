/* Segments by collocation: the residuals of its equations, and the linearisation with interior states eliminated step by
   step; kernel_source.py writes sizes, functions of the model, TAU and COEF before. A step has DEGREE points of N states,
   POINTS of all; its equations are sum_r COEF[r][i] X_r - dt f(X_i) with X_0 the state before. Arrays of interior states
   are (count, length, POINTS). */
#define POINTS (DEGREE * N)
#define SIDES_OF_STEP (1 + NF)            /* what an interior state follows: itself, the state before, the parameters */
#define KEPT (POINTS * SIDES_OF_STEP + N) /* vectors of a step that `follow` needs */
#define NEWTON 20                         /* steps for a step of the motion */
#define THRESHOLD 0.1                     /* of the largest entry below: a smaller pivot is exchanged */

long kept(void) { return KEPT; }

static inline V larger(V a, V b)
{
    for (int l = 0; l < W; l++) a[l] = a[l] > b[l] ? a[l] : b[l];
    return a;
}

static inline void input_at(V *u, const V *d, int i)
{
    for (int j = 0; j < M; j++) u[j] = d[j] + TAU[i] * (d[M + j] - d[j]);
}

static inline void gather_points(V *to, const double *from, long k, long length, long first, long count)
{
    for (int l = 0; l < W; l++) {
        const double *own = from + (SEGMENT(l) * length + k) * POINTS;
        for (int i = 0; i < POINTS; i++) to[i][l] = own[i];
    }
}

/* what is left of the equations of a step */
static inline void residual(V *gap, const V *x, const V *X, const V *f, V dt)
{
    for (int i = 0; i < DEGREE; i++)
        for (int a = 0; a < N; a++) {
            V sum = COEF[0][i] * x[a] - dt * f[i * N + a];
            for (int r = 0; r < DEGREE; r++) sum += COEF[r + 1][i] * X[r * N + a];
            gap[i * N + a] = sum;
        }
}

/* y (count, length, O), gap (count, length, POINTS), squares (count, O) of present residuals */
void gaps(long count, long length, const V *data, const double *nodes, const double *points, const double *parameters,
          const double *seen, double *y, double *gap, double *squares)
{
    for (long first = 0; first < count; first += W) {
        V x[N], p[Q], X[POINTS], f[POINTS], g[POINTS], u[M + 1], out[O], sum[O], present[O], held = (V){0} - 1.0;
        gather(x, nodes, N, first, count);
        gather(p, parameters, Q, first, count);
        for (int i = 0; i < O; i++) sum[i] = (V){0};
        for (long k = 0; k < length; k++, data += STRIDE) {
            gather_points(X, points, k, length, first, count);
            for (int i = 0; i < DEGREE; i++) {
                input_at(u, data, i);
                slope(X + i * N, u, p, f + i * N);
            }
            residual(g, x, X, f, data[2 * M]);
            output(x, data, p, out);
            scatter(gap, g, POINTS, k, length, first, count);
            scatter(y, out, O, k, length, first, count);
            choose(present, &held, data + PATTERN, seen, O);
            for (int i = 0; i < O; i++) {
                V r = where(out[i] - data[2 * M + 1 + i], present[i]);
                sum[i] += r * r;
            }
            memcpy(x, X + (DEGREE - 1) * N, sizeof x);
        }
        scatter(squares, sum, O, 0, 1, first, count);
    }
}

/* in the lanes whose pivot is small against what is below it: rows exchanged */
static inline void pivot_rows(V (*A)[POINTS], V (*b)[SIDES_OF_STEP], int c)
{
    for (int l = 0; l < W; l++) {
        int best = c;
        for (int r = c + 1; r < POINTS; r++)
            if (fabs(A[r][c][l]) > fabs(A[best][c][l])) best = r;
        if (fabs(A[c][c][l]) >= THRESHOLD * fabs(A[best][c][l])) continue;
        for (int j = c; j < POINTS; j++) {
            double held = A[c][j][l];
            A[c][j][l] = A[best][j][l];
            A[best][j][l] = held;
        }
        for (int j = 0; j < SIDES_OF_STEP; j++) {
            double held = b[c][j][l];
            b[c][j][l] = b[best][j][l];
            b[best][j][l] = held;
        }
    }
}

/* b <- -A^-1 b, of the first `sides` columns */
static inline __attribute__((always_inline)) void solve_step(V (*A)[POINTS], V (*b)[SIDES_OF_STEP], int sides)
{
    for (int c = 0; c < POINTS; c++) {
        V largest = A[c][c] * A[c][c], own = largest;
        for (int r = c + 1; r < POINTS; r++) {
            largest = larger(A[r][c] * A[r][c], largest);
        }
        int small = 0;
        for (int l = 0; l < W; l++) small |= own[l] < THRESHOLD * THRESHOLD * largest[l];
        if (small) pivot_rows(A, b, c);
        V inverse = 1.0 / A[c][c];
        for (int r = c + 1; r < POINTS; r++) {
            V factor = A[r][c];
            int any = 0;
            for (int l = 0; l < W; l++) any |= factor[l] != 0.0;
            if (!any) continue;
            factor *= inverse;
            for (int j = c + 1; j < POINTS; j++) A[r][j] -= factor * A[c][j];
            for (int j = 0; j < sides; j++) b[r][j] -= factor * b[c][j];
        }
        A[c][c] = inverse;
    }
    for (int c = POINTS - 1; c >= 0; c--) {
        for (int k = c + 1; k < POINTS; k++)
            for (int j = 0; j < sides; j++) b[c][j] -= A[c][k] * b[k][j];
        for (int j = 0; j < sides; j++) b[c][j] *= A[c][c];
    }
    for (int c = 0; c < POINTS; c++)
        for (int j = 0; j < sides; j++) b[c][j] = -b[c][j];
}

/* columns of q (O, NF + 2): derivatives, residual, what the offset of the state makes of it; q <- L q */
static inline void whiten_all(V (*restrict q)[NF + 2], const V *restrict L, long dense)
{
    for (int i = 0; i < O; i++)
        for (int c = 0; c < NF + 2; c++) q[i][c] = where(q[i][c], L[i * (i + 3) / 2]);
    for (int i = O - 1; i >= 0; i--) {
        const V *row = L + i * (i + 1) / 2;
        for (int c = 0; c < NF + 2; c++) q[i][c] *= row[i];
        for (int j = 0; dense && j < i; j++)
            for (int c = 0; c < NF + 2; c++) q[i][c] += row[j] * q[j][c];
    }
}

/* the linear system of a step at its points: A, and right sides of itself, the state before and the parameters */
static inline void system_of_step(const V *x, const V *X, const V *d, const V *p, V (*A)[POINTS],
                                  V (*b)[SIDES_OF_STEP], V *f, V *gap, V *Fs, V *Qs)
{
    V dt = d[2 * M], u[M + 1];
    memset(A, 0, POINTS * POINTS * sizeof(V));
    memset(b, 0, POINTS * SIDES_OF_STEP * sizeof(V));
    for (int i = 0; i < DEGREE; i++) {
        input_at(u, d, i);
        slopes(X + i * N, u, p, f + i * N, Fs, Qs);
        for (int a = 0; a < N; a++) {
            for (int r = 0; r < DEGREE; r++) A[i * N + a][r * N + a] = (V){0} + COEF[r + 1][i];
            b[i * N + a][1 + a] = (V){0} + COEF[0][i];
        }
        subtract_slopes(A + i * N, b + i * N, i * N, dt, Fs, Qs);
    }
    residual(gap, x, X, f, dt);
    for (int i = 0; i < POINTS; i++) b[i][0] = gap[i];
}

/* points (count, length, POINTS) of the motion from the nodes: every step by Newton's method from the state before it,
   until no step changes a point by more than `tolerance` of itself, or of scale (N) where that is larger. Not a number
   from where it finds none. `work` as of `lift`. */
UNROLLED
void motion(long count, long length, const V *data, const double *nodes, const double *parameters, const double *scale,
            double tolerance, V *work, double *points)
{
    V (*A)[POINTS] = (V (*)[POINTS])work;
    V (*b)[SIDES_OF_STEP] = (V (*)[SIDES_OF_STEP])(work + POINTS * POINTS);
    for (long first = 0; first < count; first += W) {
        V x[N], p[Q], X[POINTS], f[POINTS], gap[POINTS];
        COLLOCATION_ARRAYS;
        gather(x, nodes, N, first, count);
        gather(p, parameters, Q, first, count);
        for (long k = 0; k < length; k++, data += STRIDE) {
            for (int i = 0; i < DEGREE; i++) memcpy(X + i * N, x, sizeof x);
            V largest = (V){0} + INFINITY;
            for (int round = 0; round < NEWTON; round++) {
                system_of_step(x, X, data, p, A, b, f, gap, Fs, Qs);
                solve_step(A, b, 1);
                largest = (V){0};
                for (int i = 0; i < POINTS; i++) {
                    X[i] += b[i][0];
                    V size = larger(larger(X[i], -X[i]), (V){0} + scale[i % N]);
                    V moved = larger(b[i][0], -b[i][0]) / size;
                    for (int l = 0; l < W; l++)
                        if (!(moved[l] <= largest[l])) largest[l] = moved[l];
                }
                int open = 0;
                for (int l = 0; l < W; l++) open |= largest[l] > tolerance;
                if (!open) break;
            }
            for (int l = 0; l < W; l++)
                if (!(largest[l] <= tolerance))
                    for (int i = 0; i < POINTS; i++) X[i][l] = NAN;
            for (int l = 0; l < W && first + l < count; l++)
                for (int i = 0; i < POINTS; i++) points[((first + l) * length + k) * POINTS + i] = X[i][l];
            memcpy(x, X + (DEGREE - 1) * N, sizeof x);
        }
    }
}

/* Arrays as of `linearise` in segments.c; besides: shift (count, NF + 2), of the offset o of the predictions that the
   equations left open make and the residuals r and rows R: R'o, r'o, o'o; keep (blocks, length, KEPT) or NULL. `work` has
   POINTS * (POINTS + SIDES_OF_STEP) vectors. */
void lift(long count, long length, const V *data, const double *nodes, const double *points, const double *parameters,
          const double *weights, long dense, V *work, double *hessian, double *gradient, double *transition,
          double *end, double *shift, V *keep, double *rows)
{
    V (*A)[POINTS] = (V (*)[POINTS])work;
    V (*b)[SIDES_OF_STEP] = (V (*)[SIDES_OF_STEP])(work + POINTS * POINTS);
    for (long first = 0; first < count; first += W) {
        V x[N], p[Q], X[POINTS], f[POINTS], gap[POINTS], out[O], S[N][NF], T[N][NF], o[N], g[O][NF], moved[NF + 2];
        V q[O][NF + 2], H[NF * (NF + 1) / 2], L[TRIANGLE], held = (V){0} - 1.0;
        COLLOCATION_ARRAYS;
        gather(x, nodes, N, first, count);
        gather(p, parameters, Q, first, count);
        memset(S, 0, sizeof S);
        memset(o, 0, sizeof o);
        memset(g, 0, sizeof g);
        memset(H, 0, sizeof H);
        memset(moved, 0, sizeof moved);
        for (int i = 0; i < N; i++) S[i][i] = (V){0} + 1.0;
        for (long k = 0; k < length; k++, data += STRIDE) {
            outputs_of(x, data, p, out, Cs, Ds);
            along_outputs(q, Cs, Ds, S, o);
            choose(L, &held, data + PATTERN, weights, TRIANGLE);
            for (int i = 0; i < O; i++) q[i][NF] = out[i] - data[2 * M + 1 + i];
            whiten_all(q, L, dense);
            if (rows)
                for (int l = 0; l < W && first + l < count; l++)
                    for (int i = 0; i < O; i++)
                        for (int c = 0; c < NF; c++)
                            rows[(((first + l) * length + k) * O + i) * NF + c] = q[i][c][l];
            V *h = H;
            for (int c = 0; c < NF; c++)
                for (int e = 0; e <= c; e++) {
                    V sum = *h;
                    for (int i = 0; i < O; i++) sum += q[i][c] * q[i][e];
                    *h++ = sum;
                }
            for (int i = 0; i < O; i++) {
                V r = q[i][NF] + q[i][NF + 1];
                for (int c = 0; c < NF; c++) {
                    g[i][c] += q[i][c] * r;
                    moved[c] += q[i][c] * q[i][NF + 1];
                }
                moved[NF] += q[i][NF] * q[i][NF + 1];
                moved[NF + 1] += q[i][NF + 1] * q[i][NF + 1];
            }
            gather_points(X, points, k, length, first, count);
            system_of_step(x, X, data, p, A, b, f, gap, Fs, Qs);
            solve_step(A, b, SIDES_OF_STEP);
            if (keep) {
                memcpy(keep, b, POINTS * SIDES_OF_STEP * sizeof(V));
                keep += POINTS * SIDES_OF_STEP;
                pull(keep, q, L, dense, Cs);
                keep += N;
            }
            V (*last)[SIDES_OF_STEP] = b + (DEGREE - 1) * N;
            for (int a = 0; a < N; a++) {
                for (int c = 0; c < N; c++) T[a][c] = (V){0};
                for (int c = N; c < NF; c++) T[a][c] = last[a][1 + c];
                V sum = last[a][0];
                for (int e = 0; e < N; e++) {
                    V factor = last[a][1 + e];
                    sum += factor * o[e];
                    for (int c = 0; c < NF; c++) T[a][c] += factor * S[e][c];
                }
                gap[a] = sum;
            }
            memcpy(S, T, sizeof S);
            memcpy(o, gap, sizeof o);
            memcpy(x, X + (DEGREE - 1) * N, sizeof x);
        }
        for (int a = 0; a < N; a++) x[a] += o[a];
        scatter(end, x, N, 0, 1, first, count);
        scatter(gradient, g[0], O * NF, 0, 1, first, count);
        scatter(transition, S[0], N * NF, 0, 1, first, count);
        scatter(shift, moved, NF + 2, 0, 1, first, count);
        for (int l = 0; l < W && first + l < count; l++) {
            double *h = hessian + (first + l) * NF * NF;
            for (int c = 0, at = 0; c < NF; c++)
                for (int e = 0; e <= c; e++) h[c * NF + e] = h[e * NF + c] = H[at++][l];
        }
    }
}

/* steps (count, length, POINTS) of interior states for steps of the nodes (count, N) and parameters (count, F); price
   (count): the largest costate within a segment, times scale (N), from the multipliers (count, N) of its end */
void follow(long count, long length, const V *keep, const double *nodes, const double *local,
            const double *multipliers, const double *scale, double *steps, double *price)
{
    for (long first = 0; first < count; first += W, keep += length * KEPT) {
        V z[NF], step[POINTS], nu[N], before[N], most = (V){0};
        gather(z, nodes, N, first, count);
        gather(z + N, local, F, first, count);
        for (long k = 0; k < length; k++) {
            const V *b = keep + k * KEPT;
            for (int i = 0; i < POINTS; i++, b += SIDES_OF_STEP) {
                V sum = b[0];
                for (int c = 0; c < NF; c++) sum += b[1 + c] * z[c];
                step[i] = sum;
            }
            scatter(steps, step, POINTS, k, length, first, count);
            memcpy(z, step + (DEGREE - 1) * N, N * sizeof(V));
        }
        gather(nu, multipliers, N, first, count);
        for (long k = length - 1; k >= 0; k--) {
            const V *b = keep + k * KEPT + (DEGREE - 1) * N * SIDES_OF_STEP;
            const V *pulled = keep + k * KEPT + POINTS * SIDES_OF_STEP;
            for (int a = 0; a < N; a++) {
                V size = nu[a] * scale[a];
                most = larger(larger(size, -size), most);
            }
            for (int c = 0; c < N; c++) {
                before[c] = pulled[c];
                for (int a = 0; a < N; a++) before[c] += b[a * SIDES_OF_STEP + 1 + c] * nu[a];
            }
            memcpy(nu, before, sizeof nu);
        }
        scatter(price, &most, 1, 0, 1, first, count);
    }
}
