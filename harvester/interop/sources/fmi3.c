/* FMI 3.0 for co-simulation. */
#include <stdbool.h>
#include <stdint.h>

#include "fmi.h"

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*logger)(void *environment, fmi3Status status, const char *category,
                       const char *message);

typedef struct {
    variables now;
    logger log;
    void *environment;
} instance;

static fmi3Status failed(instance *c, const char *message)
{
    if (c->log != NULL)
        c->log(c->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT instance *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early_return, const uint32_t intermediate[], size_t intermediates,
    void *environment, logger log, void (*update)(void))
{
    instance *c;
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early_return;
    (void)intermediate, (void)intermediates, (void)update;
    if (token == NULL || strcmp(token, TOKEN) != 0)
        return NULL;
    c = calloc(1, sizeof *c);
    if (c == NULL)
        return NULL;
    c->log = log;
    c->environment = environment;
    reset(&c->now);
    return c;
}

EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
EXPORT void fmi3FreeInstance(instance *c) { free(c); }

EXPORT fmi3Status fmi3SetDebugLogging(instance *c, bool on, size_t count, const char *const names[])
{
    (void)c, (void)on, (void)count, (void)names;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterInitializationMode(instance *c, bool has_tolerance, double tolerance,
                                              double start, bool has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    c->now.device.time = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(instance *c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3Terminate(instance *c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3Reset(instance *c) { reset(&c->now); return fmi3OK; }

EXPORT fmi3Status fmi3GetFloat64(instance *c, const uint32_t references[], size_t count,
                                 double values[], size_t size)
{
    size_t k;
    (void)size;
    for (k = 0; k < count; k++)
        if (!get(&c->now, references[k], &values[k]))
            return failed(c, "no such variable");
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(instance *c, const uint32_t references[], size_t count,
                                 const double values[], size_t size)
{
    size_t k;
    (void)size;
    for (k = 0; k < count; k++)
        if (!set(&c->now, references[k], values[k]))
            return failed(c, "no such parameter or input, or not a value that it can take");
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(instance *c, double time, double length, bool no_earlier,
                             bool *event, bool *terminate, bool *early, double *reached)
{
    const char *message = step(&c->now, time, length);
    (void)no_earlier;
    *event = *terminate = *early = false;
    *reached = c->now.device.time;
    return message == NULL ? fmi3OK : failed(c, message);
}

/* What the model description says is not there. */
#define ABSENT(name) EXPORT fmi3Status name(instance *c) { return failed(c, #name " is not there"); }
#define ABSENT_TYPE(type) ABSENT(fmi3Get##type) ABSENT(fmi3Set##type)
ABSENT_TYPE(Float32) ABSENT_TYPE(Int8) ABSENT_TYPE(UInt8) ABSENT_TYPE(Int16) ABSENT_TYPE(UInt16)
ABSENT_TYPE(Int32) ABSENT_TYPE(UInt32) ABSENT_TYPE(Int64) ABSENT_TYPE(UInt64) ABSENT_TYPE(Boolean)
ABSENT_TYPE(String) ABSENT_TYPE(Binary) ABSENT_TYPE(Clock) ABSENT_TYPE(IntervalDecimal)
ABSENT_TYPE(IntervalFraction) ABSENT_TYPE(ShiftDecimal) ABSENT_TYPE(ShiftFraction)
ABSENT_TYPE(ContinuousStates) ABSENT(fmi3EnterEventMode) ABSENT(fmi3EnterStepMode)
ABSENT(fmi3GetOutputDerivatives) ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3GetNumberOfVariableDependencies) ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3SerializedFMUStateSize) ABSENT(fmi3SerializeFMUState) ABSENT(fmi3DeserializeFMUState)
ABSENT(fmi3GetDirectionalDerivative) ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3EnterConfigurationMode) ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3EvaluateDiscreteStates) ABSENT(fmi3UpdateDiscreteStates)
ABSENT(fmi3EnterContinuousTimeMode) ABSENT(fmi3CompletedIntegratorStep) ABSENT(fmi3SetTime)
ABSENT(fmi3GetContinuousStateDerivatives) ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetNominalsOfContinuousStates) ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfContinuousStates) ABSENT(fmi3GetFMUState) ABSENT(fmi3SetFMUState)
ABSENT(fmi3FreeFMUState)
