/* Whitening of many columns, compiled behind filter.c: tiles of TILE of them go through the filter side by side. A tile
   that the last columns would not fill begins earlier: what two tiles share, both compute alike. */

/* rows of tiles: c (height) += a (height, the first `most` of a row, or those of `index`; rows lie `stride` apart)
   b (most), or -= */
static inline __attribute__((always_inline)) void rows_of_tiles(int height, int minus, long most, long stride,
                                                                const double *a, const long *index, const tile *b,
                                                                tile *c)
{
    V s[6], t[6];
    for (int i = 0; i < height; i++) { s[i] = c[i].v[0]; t[i] = c[i].v[1]; }
    for (long j = 0; j < most; j++) {
        V x = b[j].v[0], y = b[j].v[1];
        const double *column = a + (index ? index[j] : j);
        for (int i = 0; i < height; i++) {
            double f = column[i * stride];
            if (minus) { s[i] -= f * x; t[i] -= f * y; }
            else { s[i] += f * x; t[i] += f * y; }
        }
    }
    for (int i = 0; i < height; i++) { c[i].v[0] = s[i]; c[i].v[1] = t[i]; }
}

/* c (rows) += a (rows, inner) b, or -=; of a lower triangle a only what is not zero. Six rows at a time, so that what is
   read of b serves six times and no sum waits for another. */
static inline __attribute__((always_inline)) void tiles(long rows, long inner, long stride, const double *a,
                                                        const long *index, const tile *b, tile *c, int minus,
                                                        int triangle)
{
    long i = 0;
    for (; i + 6 <= rows; i += 6)
        rows_of_tiles(6, minus, triangle ? i + 6 : inner, stride, a + i * stride, index, b, c + i);
    for (; i + 3 <= rows; i += 3)
        rows_of_tiles(3, minus, triangle ? i + 3 : inner, stride, a + i * stride, index, b, c + i);
    for (; i < rows; i++) rows_of_tiles(1, minus, triangle ? i + 1 : inner, stride, a + i * stride, index, b, c + i);
}

/* the first column of a tile */
static long first_of(long b, long nc) { return nc >= TILE && (b + 1) * TILE > nc ? nc - TILE : b * TILE; }

/* Innovations of columns given as Y (N,R,ny,nc), F (steps,R,nx,nc): white (N,ny,nc) of each record, whose records and
   rows lie `of_record` and `of_row` apart. Unless it is null, `held` (R,n,nc) has the states at the first sample, and
   those after the last step afterwards. A part is a tile of columns, of the first record, the second, ...; all parts of
   a sample are done before the next, as they lie in memory. */
void whiten(long from, long to, long N, long R, long n, long nx, long ny, long nc, const double *A, const double *C,
            const double *gain, const double *root, const double *Y, const double *F, double *held, long steps,
            long of_record, long of_row, double *white)
{
    tile e[MOST], out[MOST], next[MOST];
    long count = (nc + TILE - 1) / TILE, width = nc < TILE ? nc : TILE;
    tile *states = aligned_alloc(sizeof(tile), (to - from) * n * sizeof(tile));
    BEGIN
    memset(e, 0, sizeof e); memset(next, 0, sizeof next);
    memset(states, 0, (to - from) * n * sizeof(tile));
    if (held) for (long part = from; part < to; part++) for (long i = 0; i < n; i++)
        copy(states[(part - from) * n + i].d, held + (part / count * n + i) * nc + first_of(part % count, nc), width);
    for (long k = 0; k < N; k++) for (long part = from; part < to; part++) {
        long r = part / count, first = first_of(part % count, nc), at = k * R + r;
        tile *E = states + (part - from) * n;
        if (part % count == 0) {
            fetch(root, at + 2, ny * ny); fetch(gain, at + 2, n * ny); fetch(A, at + 2, n * n); fetch(C, at + 2, ny * n);
        }
        for (long i = 0; i < ny; i++) copy(e[i].d, Y + (at * ny + i) * nc + first, width);
        tiles(ny, n, n, C + at * ny * n, 0, E, e, 0, 0);
        memset(out, 0, ny * sizeof(tile));
        tiles(ny, ny, ny, root + at * ny * ny, 0, e, out, 0, 1);
        for (long i = 0; i < ny; i++) copy(white + r * of_record + (k * ny + i) * of_row + first, out[i].d, width);
        if (k == steps) continue;
        for (long i = 0; i < nx; i++) copy(next[i].d, F + (at * nx + i) * nc + first, width);
        memset(next + nx, 0, (n - nx) * sizeof(tile));
        tiles(n, ny, ny, gain + at * n * ny, 0, e, next, 1, 0);
        tiles(n, n, n, A + at * n * n, 0, E, next, 0, 0);
        memcpy(E, next, n * sizeof(tile));
    }
    if (held) for (long part = from; part < to; part++) for (long i = 0; i < n; i++)
        copy(held + (part / count * n + i) * nc + first_of(part % count, nc), states[(part - from) * n + i].d, width);
    END
    free(states);
}

/* Time histories of a tile: numbers `from` to `to`, at the `few` disturbances `used` (places among those of all);
   of each history which of these it enters at and the column that it is in. */
typedef struct { long from, to, few, *used; const long *enters, *column; } histories;

/* Of each tile of nc columns, whose histories begin at number begin[nc + 1] and enter at one of the `among`
   disturbances from number `low` on; room: four times as many as histories, and count * among. */
static void sort_histories(long count, long nc, long low, long among, const long *station, const long *begin,
                           long *room, histories *of)
{
    for (long b = 0; b < count; b++) {
        long first = first_of(b, nc), last = nc < TILE ? nc : first + TILE, few = 0, many = begin[last] - begin[first];
        long *enters = room, *column = enters + many, *used = column + many;
        room = used + among;
        for (long l = first; l < last; l++) for (long h = begin[l]; h < begin[l + 1]; h++) {
            long s = 0;
            while (s < few && used[s] != station[h] - low) s++;
            if (s == few) used[few++] = station[h] - low;
            enters[h - begin[first]] = s;
            column[h - begin[first]] = l - first;
        }
        of[b] = (histories){begin[first], begin[last], few, used, enters, column};
    }
}

/* the histories of a tile at a sample, summed by disturbance and column; whether any is not zero */
static int gather(const histories *of, const double *series, tile *to)
{
    int any = 0;
    memset(to, 0, of->few * sizeof(tile));
    for (long h = of->from; h < of->to; h++) {
        to[of->enters[h - of->from]].d[of->column[h - of->from]] += series[h];
        any |= series[h] != 0.0;
    }
    return any;
}

/* What a sample does to predicted states and to what enters at `among` disturbances from number `low` on, the closed
   loop: of rows of `wide` vectors the first ny give the innovations, the n after them the next state (not at the last
   sample). On the left, n columns, the states; then the disturbances. work: ny rows. */
static void closed_loop(long n, long nx, long ny, long nw, long low, long among, long wide, const double *A,
                        const double *C, const double *gain, const double *root, const double *Dw, const double *B0,
                        int last, V *work, V *to)
{
    long stride = wide * WIDTH;
    double *in = (double *)work, *out = (double *)(to + ny * wide);
    for (long i = 0; i < ny; i++) {
        copy(in + i * stride, C + i * n, n);
        copy(in + i * stride + n, Dw + i * nw + low, among);
    }
    zero(ny, wide, to);
    product(ny, ny, ny, 1, wide, root, work, to, 0, 1);
    if (last) return;
    zero(n, wide, to + ny * wide);
    for (long i = 0; i < n; i++) {
        copy(out + i * stride, A + i * n, n);
        if (i < nx) copy(out + i * stride + n, B0 + i * nw + low, among);
    }
    product(n, ny, ny, 1, wide, gain, work, to + ny * wide, 1, 0);
}

/* Innovations of columns that are sums of time histories: column l of series (N,R,begin[nc]) from number begin[l] to
   begin[l + 1], which enter at the disturbance number station[h], one of the `among` from `low` on, through Dw, B0, B1;
   a column is zero as long as these are. white (R,N,ny,nc); or, when `squares` is not null, only their squares (R,nc),
   summed over samples and outputs. `held` and parts as in `whiten`. */
void whiten_histories(long from, long to, long N, long R, long n, long nx, long ny, long nc, const double *A,
                      const double *C, const double *gain, const double *root, long nw, long low, long among,
                      const long *station, const long *begin, const double *series, const double *Dw, const double *B0,
                      const double *B1, double *held, double *white, double *squares)
{
    long count = (nc + TILE - 1) / TILE, width = nc < TILE ? nc : TILE, many = begin[nc], parts = to - from;
    long wide = (n + among + WIDTH - 1) / WIDTH, stride = wide * WIDTH;
    tile moved[2 * MOST];
    tile *states = aligned_alloc(sizeof(tile), (parts * (n + 1) + 2 * among) * sizeof(tile));
    tile *sums = states + parts * n, *now = sums + parts, *after = now + among;
    V *work = aligned_alloc(sizeof(V), (2 * ny + n) * wide * sizeof(V)), *loop = work + ny * wide;
    histories *of = malloc(count * sizeof(histories));
    long *room = malloc((4 * many + count * among + parts) * sizeof(long)), *begun = room + 4 * many + count * among;
    BEGIN
    sort_histories(count, nc, low, among, station, begin, room, of);
    zero(ny, wide, work);
    memset(states, 0, parts * (n + 1) * sizeof(tile));
    memset(begun, 0, parts * sizeof(long));
    if (held) for (long part = from; part < to; part++) for (long i = 0; i < n; i++) {
        tile *own = states + (part - from) * n + i;
        copy(own->d, held + (part / count * n + i) * nc + first_of(part % count, nc), width);
        for (long l = 0; l < width; l++) begun[part - from] |= own->d[l] != 0.0;
    }
    for (long k = 0; k < N; k++) for (long part = from, made = -1; part < to; part++) {
        long r = part / count, b = part % count, at = k * R + r, own = part - from, last = k == N - 1;
        double *to_white = squares ? 0 : white + (r * N + k) * ny * nc + first_of(b, nc);
        begun[own] |= gather(of + b, series + at * many, now);
        if (!last) begun[own] |= gather(of + b, series + (at + R) * many, after);
        if (!begun[own]) {
            if (!squares) for (long i = 0; i < ny; i++) memset(to_white + i * nc, 0, width * sizeof(double));
            continue;
        }
        if (made != r) {
            fetch(root, at + 2, ny * ny); fetch(gain, at + 2, n * ny); fetch(A, at + 2, n * n); fetch(C, at + 2, ny * n);
            fetch(B0, at + 2, nx * nw); fetch(B1, at + 2, nx * nw); fetch(Dw, at + 2, ny * nw);
        }
        if (made != r) closed_loop(n, nx, ny, nw, low, among, wide, A + at * n * n, C + at * ny * n, gain + at * n * ny,
                                   root + at * ny * ny, Dw + at * ny * nw, B0 + at * nx * nw, last, work, loop);
        made = r;
        long rows = last ? ny : ny + n;
        memset(moved, 0, rows * sizeof(tile));
        tiles(rows, of[b].few, stride, (const double *)loop + n, of[b].used, now, moved, 0, 0);
        if (!last) tiles(nx, of[b].few, nw, B1 + at * nx * nw + low, of[b].used, after, moved + ny, 0, 0);
        tiles(rows, n, stride, (const double *)loop, 0, states + own * n, moved, 0, 0);
        for (long i = 0; i < ny; i++) {
            if (!squares) copy(to_white + i * nc, moved[i].d, width);
            else for (int v = 0; v < 2; v++) sums[own].v[v] += moved[i].v[v] * moved[i].v[v];
        }
        if (!last) memcpy(states + own * n, moved + ny, n * sizeof(tile));
    }
    if (squares) for (long part = from; part < to; part++)
        copy(squares + part / count * nc + first_of(part % count, nc), sums[part - from].d, width);
    if (held) for (long part = from; part < to; part++) for (long i = 0; i < n; i++)
        copy(held + (part / count * n + i) * nc + first_of(part % count, nc), states[(part - from) * n + i].d, width);
    END
    free(states); free(work); free(of); free(room);
}
