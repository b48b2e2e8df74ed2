/* P <- A P A' + sum G G'; noise of intensity sigma, held over dt, has the standard deviation sigma/sqrt(dt). */
static inline void turn(V (*restrict P)[N])
{
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) {
            V held = P[i][j];
            P[i][j] = P[j][i];
            P[j][i] = held;
        }
}

static inline void spread(V (*restrict P)[N], V (*restrict d)[STAGE_COUNT][DRIVEN], V dt, const double *intensity,
                          FACTOR_ARGUMENTS)
{
    V rate = dt;
    for (int l = 0; l < W; l++) rate[l] = 1.0 / fmax(dt[l], 1e-12);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, FACTORS);
    turn(P);
    for (int j = 0; j < N; j++) homogeneous(P[j], 0, dt, FACTORS);
    for (int k = 0; k < NV; k++) {
        V g[N];
        memset(g, 0, sizeof g);
        driven(g, d[F + k], dt, FACTORS);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) P[i][j] += g[i] * g[j] * (rate * (intensity[k] * intensity[k]));
    }
}
