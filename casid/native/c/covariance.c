/* P <- A P A' + sum G G'; noise of intensity sigma, held over dt, has the standard deviation sigma/sqrt(dt). */
#define PATTERNS F1, F2, F3, F4, E1, E2, E3, E4
static inline void turn(V (*restrict P)[N])
{
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) {
            V held = P[i][j];
            P[i][j] = P[j][i];
            P[j][i] = held;
        }
}

static inline void spread(V (*restrict P)[N], V (*restrict d)[4][DRIVEN], V dt, const double *intensity,
                          const V *F1, const V *F2, const V *F3, const V *F4,
                          const V *E1, const V *E2, const V *E3, const V *E4)
{
    V rate = dt;
    for (int l = 0; l < W; l++) rate[l] = 1.0 / fmax(dt[l], 1e-12);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, PATTERNS);
    turn(P);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, PATTERNS);
    for (int k = 0; k < NV; k++) {
        V g[N];
        memset(g, 0, sizeof g);
        driven(g, d[F + k], dt, PATTERNS);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) P[i][j] += g[i] * g[j] * (rate * (intensity[k] * intensity[k]));
    }
}
