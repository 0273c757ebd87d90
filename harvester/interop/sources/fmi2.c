/* FMI 2.0 for co-simulation. */
#include "fmi.h"

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void (*logger)(void *environment, const char *instance, fmi2Status status,
                       const char *category, const char *message, ...);
typedef struct {
    logger log;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, fmi2Status status);
    void *environment;
} callbacks;

typedef struct {
    variables now;
    callbacks calls;
    char *name;
} component;

static fmi2Status failed(component *c, const char *message)
{
    if (c->calls.log != NULL)
        c->calls.log(c->calls.environment, c->name, fmi2Error, "logStatusError", "%s", message);
    return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                             const callbacks *calls, int visible, int logging)
{
    component *c;
    (void)resources, (void)visible, (void)logging;
    if (type != 1 || token == NULL || strcmp(token, TOKEN) != 0)
        return NULL;
    c = calloc(1, sizeof *c);
    if (c == NULL)
        return NULL;
    c->name = calloc(1, strlen(name) + 1);
    if (c->name != NULL)
        strcpy(c->name, name);
    if (calls != NULL)
        c->calls = *calls;
    reset(&c->now);
    return c;
}

EXPORT void fmi2FreeInstance(component *c)
{
    if (c != NULL)
        free(c->name);
    free(c);
}

EXPORT fmi2Status fmi2SetDebugLogging(component *c, int on, size_t count, const char *const names[])
{
    (void)c, (void)on, (void)count, (void)names;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(component *c, int has_tolerance, double tolerance,
                                      double start, int has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    c->now.device.time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(component *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2ExitInitializationMode(component *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Terminate(component *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(component *c) { reset(&c->now); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(component *c, const unsigned references[], size_t count,
                              double values[])
{
    size_t k;
    for (k = 0; k < count; k++)
        if (!get(&c->now, references[k], &values[k]))
            return failed(c, "no such variable");
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(component *c, const unsigned references[], size_t count,
                              const double values[])
{
    size_t k;
    for (k = 0; k < count; k++)
        if (!set(&c->now, references[k], values[k]))
            return failed(c, "no such parameter or input, or not a value that it can take");
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(component *c, const unsigned references[],
                                              size_t count, const int orders[],
                                              const double values[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (orders[k] != 1 || (references[k] != BASE_ACCELERATION && references[k] != TERMINAL))
            return failed(c, "only first derivatives of the two inputs can be set");
        *(references[k] == TERMINAL ? &c->now.device.terminal_slope : &c->now.device.base_slope) =
            values[k];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(component *c, double time, double length, int no_earlier)
{
    const char *message = step(&c->now, time, length);
    (void)no_earlier;
    return message == NULL ? fmi2OK : failed(c, message);
}

EXPORT fmi2Status fmi2CancelStep(component *c) { (void)c; return fmi2Error; }

/* What the model description says is not there. */
#define ABSENT(name) EXPORT fmi2Status name(component *c) { return failed(c, #name " is not there"); }
ABSENT(fmi2GetInteger) ABSENT(fmi2GetBoolean) ABSENT(fmi2GetString)
ABSENT(fmi2SetInteger) ABSENT(fmi2SetBoolean) ABSENT(fmi2SetString)
ABSENT(fmi2GetFMUstate) ABSENT(fmi2SetFMUstate) ABSENT(fmi2FreeFMUstate)
ABSENT(fmi2SerializedFMUstateSize) ABSENT(fmi2SerializeFMUstate) ABSENT(fmi2DeSerializeFMUstate)
ABSENT(fmi2GetDirectionalDerivative) ABSENT(fmi2GetRealOutputDerivatives)
ABSENT(fmi2GetStatus) ABSENT(fmi2GetRealStatus) ABSENT(fmi2GetIntegerStatus)
ABSENT(fmi2GetBooleanStatus) ABSENT(fmi2GetStringStatus)
