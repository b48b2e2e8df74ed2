/* The step matrices of a linearised model, compiled behind filter.c; casid/filtering/innovations.py says what they are. */
/* to (nx rows of `wide` vectors) = K x */
static inline void moved_by(long nx, long wide_x, long wide, const V *K, const V *x, V *to)
{
    zero(nx, wide, to);
    product(nx, nx, wide_x * WIDTH, 1, wide, (const double *)K, x, to, 0, 0);
}

/* slopes of a step in rows of vectors: J at its beginning, K at its end, and S = K J; from Jacobians in rows of nx */
static void slopes(long nx, long wide_x, const double *first, const double *last, V *J, V *K, V *S)
{
    pack(nx, nx, wide_x, first, J);
    pack(nx, nx, wide_x, last, K);
    moved_by(nx, wide_x, wide_x, K, J, S);
}

/* Bp (nx, np) of a step, from slopes by parameters at its beginning and at its end; room: five times their rows */
static void by_parameters(long nx, long wide_x, long np, double h, const V *K, const V *S, const double *first,
                          const double *last, V *room, double *Bp)
{
    long wide = (np + WIDTH - 1) / WIDTH, all = nx * wide;
    V *P = room, *P1 = P + all, *moved = P1 + all, *both = moved + all, *twice = both + all;
    pack(nx, np, wide, first, P);
    pack(nx, np, wide, last, P1);
    moved_by(nx, wide_x, wide, K, P, moved);
    for (long v = 0; v < all; v++) both[v] = h / 6 * P[v] + h * h / 24 * moved[v];
    moved_by(nx, wide_x, wide, S, both, twice);
    for (long v = 0; v < all; v++) both[v] = h / 2 * (P[v] + P1[v]) + h * h * (moved[v] / 2 + twice[v]);
    unpack(nx, np, wide, both, Bp);
}

/* to (ny rows) = rows of the output equation, 0 where it is not seen */
static void outputs(long ny, long columns, const double *by, const unsigned char *seen, double *to)
{
    for (long i = 0; i < ny; i++)
        if (seen[i]) memcpy(to + i * columns, by + i * columns, columns * sizeof(double));
        else memset(to + i * columns, 0, columns * sizeof(double));
}

/* a row (nw) of B0 and B1, from slopes W and W1 at both ends, K W and S W: in vectors, as nothing overlaps */
static void stations(long nw, double h, const double *restrict moved, const double *restrict twice,
                     const double *restrict W, const double *restrict W1, const double *restrict early,
                     const double *restrict late, double *restrict b0, double *restrict b1)
{
    for (long j = 0; j < nw; j++) {
        double once = h * h * moved[j], again = h * h * h * twice[j];
        double first = h / 2 * W[j] + once / 3 + again / 8, second = h / 2 * W1[j] + once / 6 + again / 24;
        b0[j] = (1.0 - early[j]) * first + late[j] * second;
        b1[j] = (1.0 - late[j]) * second + early[j] * first;
    }
}

/* Step matrices of `innovations.linearise` from Jacobians (N,R,nx+ny,columns) of state and output equations, and the
   same (N-1,...) at the ends of the intervals. */
void interval(long from, long to, long N, long R, long nx, long ny, long np, long nw, const double *by_x,
              const double *by_p, const double *by_w, const double *end_x, const double *end_p,
              const double *end_w, const double *dt, const unsigned char *live, const double *held,
              const unsigned char *seen, double *A, double *Bp, double *B0, double *B1, double *C, double *Dp,
              double *Dw)
{
    long rows = nx + ny, wide = (nx + WIDTH - 1) / WIDTH, wide_p = (np + WIDTH - 1) / WIDTH;
    long wide_w = (nw + WIDTH - 1) / WIDTH, widest = wide > wide_w ? wide : wide_w, all = nx * wide;
    long size = nx * (3 * wide + (5 * wide_p > 3 * widest ? 5 * wide_p : 3 * widest));
    V *J = aligned_alloc(sizeof(V), size * sizeof(V)), *K = J + all, *S = K + all, *room = S + all;
    double *late = malloc(2 * R * nw * sizeof(double)), *early = late + R * nw; /* shares of an interval */
    for (long i = 0; i < R * nw; i++) { late[i] = fmax(held[i], 0.0); early[i] = fmax(-held[i], 0.0); }
    zero(size, 1, J);
    for (long k = from; k < to; k++) for (long r = 0; r < R; r++) {
        long at = k * R + r, next = at + R;
        const double *x = by_x + at * rows * nx, *P = by_p + at * rows * np, *W = by_w + at * rows * nw;
        outputs(ny, nx, x + nx * nx, seen + at * ny, C + at * ny * nx);
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
        const double *P1 = end_p + at * rows * np, *W1 = end_w + at * rows * nw;
        slopes(nx, wide, x, end_x + at * rows * nx, J, K, S);
        V *moved = room, *twice = room + nx * widest;
        for (long v = 0; v < all; v++) moved[v] = h / 12 * (J[v] + K[v]) + h * h / 24 * S[v];
        moved_by(nx, wide, wide, S, moved, twice);
        for (long v = 0; v < all; v++) moved[v] = h / 2 * (J[v] + K[v]) + h * h * (S[v] / 2 + twice[v]);
        unpack(nx, nx, wide, moved, a);
        for (long i = 0; i < nx; i++) a[i * nx + i] += 1.0;
        if (np) by_parameters(nx, wide, np, h, K, S, P, P1, room, bp);
        V *now = room + 2 * nx * widest;
        pack(nx, nw, wide_w, W, now);
        moved_by(nx, wide, wide_w, K, now, moved);
        moved_by(nx, wide, wide_w, S, now, twice);
        for (long i = 0; i < nx; i++)
            stations(nw, h, (double *)(moved + i * wide_w), (double *)(twice + i * wide_w), W + i * nw, W1 + i * nw,
                     early + r * nw, late + r * nw, b0 + i * nw, b1 + i * nw);
    }
    free(J);
    free(late);
}

/* Bp and Dp alone, from Jacobians (N,R,nx,nx) of the state equations and (N,R,nx+ny,np) of both, and the same
   (N-1,...) at the ends of the intervals. */
void driven(long from, long to, long N, long R, long nx, long ny, long np, const double *by_x, const double *by_p,
            const double *end_x, const double *end_p, const double *dt, const unsigned char *live,
            const unsigned char *seen, double *Bp, double *Dp)
{
    long rows = nx + ny, wide = (nx + WIDTH - 1) / WIDTH, wide_p = (np + WIDTH - 1) / WIDTH, all = nx * wide;
    long size = nx * (3 * wide + 5 * wide_p);
    V *J = aligned_alloc(sizeof(V), size * sizeof(V)), *K = J + all, *S = K + all, *room = S + all;
    zero(size, 1, J);
    for (long k = from; k < to; k++) for (long r = 0; r < R; r++) {
        long at = k * R + r, next = at + R;
        const double *P = by_p + at * rows * np;
        outputs(ny, np, P + nx * np, seen + at * ny, Dp + at * ny * np);
        if (k == N - 1) continue;
        if (!live[next]) { memset(Bp + at * nx * np, 0, nx * np * sizeof(double)); continue; }
        slopes(nx, wide, by_x + at * nx * nx, end_x + at * nx * nx, J, K, S);
        by_parameters(nx, wide, np, dt[at], K, S, P, end_p + at * rows * np, room, Bp + at * nx * np);
    }
    free(J);
}
