/* The step matrices of a linearised model, compiled behind filter.c; casid/filtering/innovations.py says what they are. */
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
              const double *held, const unsigned char *seen, double *A, double *Bp, double *B0, double *B1,
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
                double share = held[r * nw + j];
                b0[i * nw + j] = share > 0.0 ? first + share * second : (1.0 + share) * first;
                b1[i * nw + j] = share > 0.0 ? (1.0 - share) * second : second - share * first;
            }
        }
    }
}
