/* Two units for model exchange by the equations of the reference FMUs: the oscillator of van der Pol, here with a force,
 * and with -DDAHLQUIST the test equation of Dahlquist. As in these a parameter cannot be set while time is continuous. */
#include "fmi2Functions.h"
#include <stdlib.h>
#include <string.h>

typedef struct {
    double v[6];
    int continuous;
} Unit;

#ifdef DAHLQUIST
enum { STATES = 1, VARIABLES = 3, PARAMETER = 2 }; /* x der(x) k */
static const double START[] = {1.0, 0.0, 1.0};
static void calculate(double *v) { v[1] = -v[2] * v[0]; }
#else
enum { STATES = 2, VARIABLES = 6, PARAMETER = 4 }; /* x0 der(x0) x1 der(x1) mu force */
static const double START[] = {2.0, 0.0, 0.0, 0.0, 1.0, 0.0};
static void calculate(double *v) {
    v[1] = v[2];
    v[3] = v[4] * (1.0 - v[0] * v[0]) * v[2] - v[0] + v[5];
}
#endif

#define OF(c) ((Unit *)(c))
typedef fmi2Component C;

static void start(Unit *u) {
    memcpy(u->v, START, sizeof START);
    u->continuous = 0;
}
C fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f, fmi2Boolean v,
                  fmi2Boolean l) {
    Unit *u = calloc(1, sizeof(Unit));
    start(u);
    return u;
}
void fmi2FreeInstance(C c) { free(c); }
fmi2Status fmi2Reset(C c) { return start(OF(c)), fmi2OK; }
fmi2Status fmi2GetReal(C c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
    calculate(OF(c)->v);
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= VARIABLES) return fmi2Error;
        v[i] = OF(c)->v[r[i]];
    }
    return fmi2OK;
}
fmi2Status fmi2SetReal(C c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= VARIABLES || (r[i] == PARAMETER && OF(c)->continuous)) return fmi2Error;
        OF(c)->v[r[i]] = v[i];
    }
    return fmi2OK;
}
fmi2Status fmi2SetContinuousStates(C c, const fmi2Real x[], size_t n) {
    for (size_t i = 0; i < n; i++) OF(c)->v[2 * i] = x[i];
    return fmi2OK;
}
fmi2Status fmi2GetContinuousStates(C c, fmi2Real x[], size_t n) {
    for (size_t i = 0; i < n; i++) x[i] = OF(c)->v[2 * i];
    return fmi2OK;
}
fmi2Status fmi2GetDerivatives(C c, fmi2Real x[], size_t n) {
    calculate(OF(c)->v);
    for (size_t i = 0; i < n; i++) x[i] = OF(c)->v[2 * i + 1];
    return fmi2OK;
}
fmi2Status fmi2NewDiscreteStates(C c, fmi2EventInfo *e) { return memset(e, 0, sizeof *e), fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(C c) { return OF(c)->continuous = 1, fmi2OK; }
fmi2Status fmi2EnterEventMode(C c) { return OF(c)->continuous = 0, fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(C c, fmi2Boolean n, fmi2Boolean *a, fmi2Boolean *b) {
    return *a = *b = fmi2False, fmi2OK;
}

/* what these units have no use for */
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
#define EMPTY(name, ...) fmi2Status fmi2##name(C c, ##__VA_ARGS__) { return fmi2OK; }
#define NEVER(name, ...) fmi2Status fmi2##name(C c, ##__VA_ARGS__) { return fmi2Error; }
EMPTY(SetDebugLogging, fmi2Boolean l, size_t n, const fmi2String s[])
EMPTY(SetupExperiment, fmi2Boolean a, fmi2Real b, fmi2Real d, fmi2Boolean e, fmi2Real f)
EMPTY(EnterInitializationMode)
EMPTY(ExitInitializationMode)
EMPTY(Terminate)
EMPTY(SetTime, fmi2Real t)
EMPTY(GetEventIndicators, fmi2Real z[], size_t n)
NEVER(GetNominalsOfContinuousStates, fmi2Real x[], size_t n)
#define ARRAY(T) const fmi2ValueReference r[], size_t n, T v[]
NEVER(GetInteger, ARRAY(fmi2Integer))
NEVER(GetBoolean, ARRAY(fmi2Boolean))
NEVER(GetString, ARRAY(fmi2String))
NEVER(SetInteger, ARRAY(const fmi2Integer))
NEVER(SetBoolean, ARRAY(const fmi2Boolean))
NEVER(SetString, ARRAY(const fmi2String))
NEVER(GetFMUstate, fmi2FMUstate *s)
NEVER(SetFMUstate, fmi2FMUstate s)
NEVER(FreeFMUstate, fmi2FMUstate *s)
NEVER(SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
NEVER(SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
NEVER(DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
NEVER(GetDirectionalDerivative, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[], size_t nk,
      const fmi2Real d[], fmi2Real o[])
