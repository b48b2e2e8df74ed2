/* The step matrices of a linearised model, compiled behind filter.c; casid/filtering/innovations.py says what they are. */
/* to (nx, n) = K x, both in rows of n; zeros of K, of which a model has many, cost nothing */
static void moved_by(long nx, long n, const double *K, const double *x, double *restrict to)
{
    for (long i = 0; i < nx; i++, to += n) {
        memset(to, 0, n * sizeof(double));
        for (long l = 0; l < nx; l++) {
            double f = K[i * nx + l];
            if (f != 0.0) for (long j = 0; j < n; j++) to[j] += f * x[l * n + j];
        }
    }
}

/* to (ny rows) = rows of the output equation, 0 where it is not seen */
static void outputs(long ny, long columns, const double *by, const unsigned char *seen, double *to)
{
    for (long i = 0; i < ny; i++)
        if (seen[i]) memcpy(to + i * columns, by + i * columns, columns * sizeof(double));
        else memset(to + i * columns, 0, columns * sizeof(double));
}

/* Step matrices of `innovations.linearise` from Jacobians (N,R,nx+ny,columns) of state and output equations. */
void interval(long from, long to, long N, long R, long nx, long ny, long np, long nw, const double *by_x,
              const double *by_p, const double *by_w, const double *dt, const unsigned char *live,
              const double *held, const unsigned char *seen, double *A, double *Bp, double *B0, double *B1,
              double *C, double *Dp, double *Dw)
{
    long rows = nx + ny, widest = nx > np ? nx : np;
    long room = nx * (widest > nw ? widest : nw);
    double *moved = malloc((2 * room + nx * nx) * sizeof(double)), *twice = moved + room, *S = twice + room;
    for (long k = from; k < to; k++) for (long r = 0; r < R; r++) {
        long at = k * R + r, next = at + R;
        const double *J = by_x + at * rows * nx, *P = by_p + at * rows * np, *W = by_w + at * rows * nw;
        outputs(ny, nx, J + nx * nx, seen + at * ny, C + at * ny * nx);
        outputs(ny, np, P + nx * np, seen + at * ny, Dp + at * ny * np);
        outputs(ny, nw, W + nx * nw, seen + at * ny, Dw + at * ny * nw);
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
        const double *K = by_x + next * rows * nx, *P1 = by_p + next * rows * np, *W1 = by_w + next * rows * nw;
        moved_by(nx, nx, K, J, S);
        for (long i = 0; i < nx * nx; i++) moved[i] = h / 12 * (J[i] + K[i]) + h * h / 24 * S[i];
        moved_by(nx, nx, S, moved, twice);
        for (long i = 0; i < nx * nx; i++) a[i] = h / 2 * (J[i] + K[i]) + h * h * (S[i] / 2 + twice[i]);
        for (long i = 0; i < nx; i++) a[i * nx + i] += 1.0;
        moved_by(nx, np, K, P, moved);
        for (long ij = 0; ij < nx * np; ij++) bp[ij] = h / 6 * P[ij] + h * h / 24 * moved[ij];
        moved_by(nx, np, S, bp, twice);
        for (long ij = 0; ij < nx * np; ij++)
            bp[ij] = h / 2 * (P[ij] + P1[ij]) + h * h * (moved[ij] / 2 + twice[ij]);
        moved_by(nx, nw, K, W, moved);
        moved_by(nx, nw, S, W, twice);
        for (long i = 0; i < nx; i++) for (long j = 0; j < nw; j++) {
            long ij = i * nw + j;
            double once = h * h * moved[ij], again = h * h * h * twice[ij];
            double first = h / 2 * W[ij] + once / 3 + again / 8, second = h / 2 * W1[ij] + once / 6 + again / 24;
            double share = held[r * nw + j], late = fmax(share, 0.0), early = fmax(-share, 0.0);
            b0[ij] = (1.0 - early) * first + late * second;
            b1[ij] = (1.0 - late) * second + early * first;
        }
    }
    free(moved);
}
