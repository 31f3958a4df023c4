/* A co-simulation FMU for the tests: a first-order lag, T dy/dt = gain u - y, solved exactly. Of version FMI, 2 or 3.
 *
 * It is a strict one: it checks what it is given, refuses calls in a wrong order or at a wrong time, and ends the program if it is called
 * after a fatal error, or terminated after an error. It logs why it refuses. From its fourth step on it does what the parameter `fault` says.
 */
#include <dirent.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
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
    STEP_WARNING, OUT_OF_RANGE, LOGS_NONSENSE, NO_BOOLEAN, STEP_UNKNOWN, LOGS
};

typedef struct {
    double u, y, gain, t, now;
    int32_t steps, fault, invert;
    int state, has_failed, is_fatal;
    void (*log)(void);
    void *environment;
    bool is_debugged;
} Model;

static void say(const Model *m, int status, const char *category, const char *text);

static int faulty(const Model *m, int fault) { return m->fault == fault && m->steps >= 4; }

static int fails(Model *m, int status) {
    m->has_failed |= status != OK && status != WARNING;
    m->is_fatal |= status == FATAL;
    return status;
}

static void alive(const Model *m) {
    if (m->is_fatal) abort();
}

static Model *refuse(Model *m, const char *why) {
    say(m, ERROR, "logStatusError", why);
    free(m);
    return NULL;
}

/* `resources` is the path of a folder, with a separator at its end. */
static Model *create(const char *token, const char *resources, void (*log)(void), void *environment, bool is_debugged) {
    Model *m = calloc(1, sizeof *m);
    if (m == NULL) return NULL;
    m->log = log;
    m->environment = environment;
    m->is_debugged = is_debugged;
    m->gain = 1.0;
    m->t = 1.0;
#ifdef MUTE
    free(m);
    return NULL;
#endif
    if (is_debugged) say(m, OK, "logEvents", "instantiating");
    if (strcmp(token, TOKEN) != 0) return refuse(m, "the token is another one");
    if (environment == NULL) return refuse(m, "there is no environment");
    size_t length = resources == NULL ? 0 : strlen(resources);
    if (length < 2 || resources[0] != '/' || resources[length - 1] != '/') return refuse(m, "the path of the resources is none of the standard");
    DIR *folder = opendir(resources);
    if (folder == NULL) return refuse(m, "the folder of the resources is not there");
    closedir(folder);
#ifdef READS
    char path[8192];
    if (length > 4096) return refuse(m, "the path of the resources is too long");
    snprintf(path, sizeof path, "%s%s", resources, "y.txt");
    FILE *file = fopen(path, "r");
    if (file == NULL) return refuse(m, "y.txt is not in the resources");
    int count = fscanf(file, "%lf", &m->y);
    fclose(file);
    if (count != 1) return refuse(m, "there is no number in y.txt");
#endif
    return m;
}

static int enter(Model *m) {
    alive(m);
    if (m->fault == INIT_ERROR) say(m, ERROR, "logStatusError", "it does not converge");
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
    if (faulty(m, LOGS)) {
        say(m, WARNING, "logStatusWarning", "hot");
        say(m, OK, "logEvents", "a step");
        say(m, ERROR, NULL, "too hot\n");
    }
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

typedef struct {
    void (*log)(void);
    void *(*allocate)(size_t, size_t);
    void (*free)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

/* With arguments that are of a double and an integer, and more than registers hold. */
static void say(const Model *m, int status, const char *category, const char *text) {
    ((Log)m->log)(m->environment, "lag", status, category, "%s (%g, %d, %g, %g, %g, %g, %g, %g, %g, %s)", text, 1.5, 7, 2.0, 3.0, 4.0, 5.0, 6.0,
        7.0, 8.5, "end");
}

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
    if (type != 1 || *name == 0 || callbacks == NULL || visible) return NULL;
    const Callbacks *given = callbacks;
    char path[4096] = "";
    if (resources != NULL && strncmp(resources, "file:///", 8) == 0) snprintf(path, sizeof path, "%s/", resources + 7);
    return create(guid, path, given->log, given->environment, logging);
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

static void say(const Model *m, int status, const char *category, const char *text) {
    ((Log)m->log)(m->environment, status, category, text);
}

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
    (void)required;
    if (*name == 0 || visible || events || early || n != 0 || log == NULL || intermediate != NULL) return NULL;
    void (*logger)(void);
    memcpy(&logger, &log, sizeof logger);
    return create(token, resources, logger, environment, logging);
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
