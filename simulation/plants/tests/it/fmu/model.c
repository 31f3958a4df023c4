/* A co-simulation FMU for the tests: a first-order lag, T dy/dt = gain u - y, solved exactly. Of version FMI, 2 or 3.
 *
 * It is a strict one: it refuses calls in a wrong order or at a wrong time, and ends the program if it is called after a fatal error, or
 * terminated after an error. From its fourth step on it does what the parameter `fault` says.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifndef TOKEN
#define TOKEN "{lag}"
#endif

enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING };
enum { U, Y, STEPS, GAIN, T, FAULT, INVERT, IS_HIGH };
enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };
enum {
    NO_FAULT, STEP_DISCARD, STEP_ERROR, STEP_FATAL, NOT_A_NUMBER, STEP_PENDING, STEP_TERMINATE, STEP_EARLY, GET_ERROR, SET_ERROR, INIT_ERROR,
    STEP_WARNING, OUT_OF_RANGE, LOGS_NONSENSE, NO_BOOLEAN, STEP_UNKNOWN
};

typedef struct {
    double u, y, gain, t, now;
    int32_t steps, fault, invert;
    int state, has_failed, is_fatal;
    void (*log)(void);
} Model;

static int faulty(const Model *m, int fault) { return m->fault == fault && m->steps >= 4; }

static int fails(Model *m, int status) {
    m->has_failed |= status != OK && status != WARNING;
    m->is_fatal |= status == FATAL;
    return status;
}

static void alive(const Model *m) {
    if (m->is_fatal) abort();
}

static Model *create(const char *token) {
    if (strcmp(token, TOKEN) != 0) return NULL;
    Model *m = calloc(1, sizeof *m);
    if (m != NULL) {
        m->gain = 1.0;
        m->t = 1.0;
    }
    return m;
}

static int enter(Model *m) {
    alive(m);
    if (m->state != INSTANTIATED || m->fault == INIT_ERROR) return fails(m, ERROR);
    m->state = INITIALIZING;
    return OK;
}

static int leave(Model *m) {
    alive(m);
    if (m->state != INITIALIZING) return fails(m, ERROR);
    m->state = STEPPING;
    return OK;
}

static int terminate(Model *m) {
    alive(m);
    if (m->has_failed || m->state != STEPPING) abort();
    m->state = TERMINATED;
    return OK;
}

static void destroy(Model *m) {
    alive(m);
    free(m);
}

static void log_nonsense(const Model *m);

__attribute__((unused)) static int step(Model *m, double at, double by) {
    alive(m);
    if (m->state != STEPPING || fabs(at - m->now) > 1e-9 || !(by > 0)) return fails(m, ERROR);
    m->steps++;
    if (faulty(m, STEP_DISCARD)) return fails(m, DISCARD);
    if (faulty(m, STEP_ERROR)) return fails(m, ERROR);
    if (faulty(m, STEP_FATAL)) return fails(m, FATAL);
    if (faulty(m, STEP_PENDING)) return fails(m, PENDING);
    if (faulty(m, STEP_UNKNOWN)) return fails(m, 42);
    if (faulty(m, LOGS_NONSENSE)) log_nonsense(m);
    double target = m->gain * (m->invert ? -m->u : m->u);
    m->y = target + (m->y - target) * exp(-by / m->t);
    m->now += by;
    return faulty(m, STEP_WARNING) ? WARNING : OK;
}

static int get_real(Model *m, const unsigned *vr, size_t n, double *to) {
    alive(m);
    if (faulty(m, GET_ERROR)) return fails(m, ERROR);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != Y) return fails(m, ERROR);
        to[i] = faulty(m, NOT_A_NUMBER) ? NAN : faulty(m, OUT_OF_RANGE) ? 1e6 : m->y;
    }
    return OK;
}

static int set_real(Model *m, const unsigned *vr, size_t n, const double *from) {
    alive(m);
    if (faulty(m, SET_ERROR)) return fails(m, ERROR);
    for (size_t i = 0; i < n; i++) {
        switch (vr[i]) {
        case U: m->u = from[i]; break;
        case GAIN: m->gain = from[i]; break;
        case T: m->t = from[i]; break;
        default: return fails(m, ERROR);
        }
    }
    return OK;
}

static int get_integer(Model *m, const unsigned *vr, size_t n, int32_t *to) {
    alive(m);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != STEPS) return fails(m, ERROR);
        to[i] = m->steps;
    }
    return OK;
}

static int set_integer(Model *m, const unsigned *vr, size_t n, const int32_t *from) {
    alive(m);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != FAULT) return fails(m, ERROR);
        m->fault = from[i];
    }
    return OK;
}

#define EXPORT __attribute__((visibility("default")))

#if FMI == 2

typedef void *Component;
typedef void (*Log)(void *environment, const char *name, int status, const char *category, const char *message, ...);

/* Without a look whether it was asked to log, as some do. */
static void log_nonsense(const Model *m) {
    ((Log)m->log)(NULL, NULL, 99, NULL, "%s is %f of %d", "it", 1.5, 7);
    ((Log)m->log)(NULL, "lag", PENDING, NULL, NULL);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
#ifdef NO_VERSION
EXPORT const char *fmi2GetVersion(void) { return NULL; }
#elif defined NO_TEXT
EXPORT const char *fmi2GetVersion(void) { return "\xff\xfe"; }
#elif defined OTHER_VERSION
EXPORT const char *fmi2GetVersion(void) { return "1.0"; }
#else
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
#endif
EXPORT Component fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks, int visible, int logging) {
    (void)resources, (void)visible, (void)logging;
    if (type != 1 || *name == 0 || callbacks == NULL) return NULL;
    Model *m = create(guid);
    /* It is the first of them. */
    if (m != NULL) memcpy(&m->log, callbacks, sizeof m->log);
    return m;
}
EXPORT void fmi2FreeInstance(Component c) { destroy(c); }
EXPORT int fmi2SetupExperiment(Component c, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((Model *)c)->now = start;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(Component c) { return enter(c); }
EXPORT int fmi2ExitInitializationMode(Component c) { return leave(c); }
EXPORT int fmi2Terminate(Component c) { return terminate(c); }
EXPORT int fmi2GetReal(Component c, const unsigned *vr, size_t n, double *to) { return get_real(c, vr, n, to); }
EXPORT int fmi2SetReal(Component c, const unsigned *vr, size_t n, const double *from) { return set_real(c, vr, n, from); }
EXPORT int fmi2GetInteger(Component c, const unsigned *vr, size_t n, int *to) { return get_integer(c, vr, n, to); }
EXPORT int fmi2SetInteger(Component c, const unsigned *vr, size_t n, const int *from) { return set_integer(c, vr, n, from); }
EXPORT int fmi2GetBoolean(Component c, const unsigned *vr, size_t n, int *to) {
    if (n != 1 || vr[0] != IS_HIGH) return fails(c, ERROR);
    to[0] = ((Model *)c)->y > 1;
    return OK;
}
EXPORT int fmi2SetBoolean(Component c, const unsigned *vr, size_t n, const int *from) {
    if (n != 1 || vr[0] != INVERT) return fails(c, ERROR);
    ((Model *)c)->invert = from[0];
    return OK;
}
#ifndef NO_STEP
EXPORT int fmi2DoStep(Component c, double at, double by, int is_final) {
    (void)is_final;
    return step(c, at, by);
}
#endif

#else

typedef void *Instance;
typedef void (*Log)(void *environment, int status, const char *category, const char *message);

static void log_nonsense(const Model *m) {
    ((Log)m->log)(NULL, 99, NULL, NULL);
    ((Log)m->log)(NULL, PENDING, "\xff", NULL);
}

#ifdef NO_VERSION
EXPORT const char *fmi3GetVersion(void) { return NULL; }
#elif defined NO_TEXT
EXPORT const char *fmi3GetVersion(void) { return "\xff\xfe"; }
#else
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
#endif
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool events,
    bool early, const uint32_t *required, size_t n, void *environment, void *log, void *intermediate) {
    (void)resources, (void)visible, (void)logging, (void)required, (void)environment, (void)intermediate;
    if (*name == 0 || events || early || n != 0) return NULL;
    Model *m = create(token);
    if (m != NULL) memcpy(&m->log, &log, sizeof m->log);
    return m;
}
EXPORT void fmi3FreeInstance(Instance c) { destroy(c); }
EXPORT int fmi3EnterInitializationMode(Instance c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((Model *)c)->now = start;
    return enter(c);
}
EXPORT int fmi3ExitInitializationMode(Instance c) { return leave(c); }
EXPORT int fmi3Terminate(Instance c) { return terminate(c); }
EXPORT int fmi3GetFloat64(Instance c, const uint32_t *vr, size_t n, double *to, size_t values) {
    return n == values ? get_real(c, vr, n, to) : fails(c, ERROR);
}
EXPORT int fmi3SetFloat64(Instance c, const uint32_t *vr, size_t n, const double *from, size_t values) {
    return n == values ? set_real(c, vr, n, from) : fails(c, ERROR);
}
EXPORT int fmi3GetInt32(Instance c, const uint32_t *vr, size_t n, int32_t *to, size_t values) {
    return n == values ? get_integer(c, vr, n, to) : fails(c, ERROR);
}
EXPORT int fmi3SetInt32(Instance c, const uint32_t *vr, size_t n, const int32_t *from, size_t values) {
    return n == values ? set_integer(c, vr, n, from) : fails(c, ERROR);
}
EXPORT int fmi3GetBoolean(Instance c, const uint32_t *vr, size_t n, bool *to, size_t values) {
    if (n != 1 || values != 1 || vr[0] != IS_HIGH) return fails(c, ERROR);
    to[0] = ((Model *)c)->y > 1;
    /* No bool, but a byte where one is wanted. */
    if (faulty(c, NO_BOOLEAN)) memset(to, 2, 1);
    return OK;
}
EXPORT int fmi3SetBoolean(Instance c, const uint32_t *vr, size_t n, const bool *from, size_t values) {
    if (n != 1 || values != 1 || vr[0] != INVERT) return fails(c, ERROR);
    ((Model *)c)->invert = from[0];
    return OK;
}
EXPORT int fmi3DoStep(Instance c, double at, double by, bool no_set_state, bool *event, bool *end, bool *early, double *reached) {
    (void)no_set_state;
    Model *m = c;
    int status = step(m, at, by);
    *event = false;
    *end = faulty(m, STEP_TERMINATE);
    *early = faulty(m, STEP_EARLY);
    *reached = m->now;
    return status;
}

#endif
