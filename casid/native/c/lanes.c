/* Lanes are segments: what brings numbers of segments into them and back; sizes stand before. */
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

typedef long long BITS __attribute__((vector_size(8 * W)));

/* v, or zero where `on` is: what is not measured may be no number */
static inline V where(V v, V on) { return (V)((BITS)v & (BITS)(on != 0.0)); }

#define PATTERN (2 * M + 1 + O)
#define TRIANGLE (O * (O + 1) / 2)

/* the row of a table that each lane's pattern says; `held` is the pattern that `to` is of already; whether it changed */
static inline int choose(V *to, V *held, const V *pattern, const double *table, int width)
{
    if (!memcmp(held, pattern, sizeof(V))) return 0;
    *held = *pattern;
    for (int l = 0; l < W; l++)
        for (int i = 0; i < width; i++) to[i][l] = table[(long)(*pattern)[l] * width + i];
    return 1;
}
