/* What FMI 2.0 and 3.0 share: an instance, its variables by value reference, a step. */
#ifndef HARVESTER_FMI_H
#define HARVESTER_FMI_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "harvester_device.h"
#include "token.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* In the order of the model description. */
enum {
    TIME, BASE_ACCELERATION, TERMINAL, LOAD_RESISTANCE, START_DISPLACEMENT, START_VELOCITY,
    START_STATE, OUTPUT, DISPLACEMENT, VELOCITY, ENERGY_INPUT, ENERGY_STORED, ENERGY_DAMPER,
    ENERGY_CONTACTS, ENERGY_TRANSDUCER, ENERGY_DELIVERED, VARIABLES
};

typedef struct {
    harvester_device device;
    double start[3];
    int begun; /* whose start can no longer be set */
} variables;

static void reset(variables *v)
{
    harvester_reset(&v->device);
    v->begun = 0;
    v->start[0] = harvester_displacement(&v->device);
    v->start[1] = harvester_velocity(&v->device);
    v->start[2] = v->device.state[HARVESTER_STATE];
}

static double *setting(variables *v, unsigned reference)
{
    switch (reference) {
    case BASE_ACCELERATION: return &v->device.base_acceleration;
    case TERMINAL: return &v->device.terminal;
    case LOAD_RESISTANCE: return &v->device.load_resistance;
    case START_DISPLACEMENT: return &v->start[0];
    case START_VELOCITY: return &v->start[1];
    case START_STATE: return &v->start[2];
    default: return NULL;
    }
}

static int set(variables *v, unsigned reference, double value)
{
    double *place = setting(v, reference);
    if (place == NULL || !(value - value == 0.0) || (reference == LOAD_RESISTANCE && value < 0.0))
        return 0;
    if (reference >= START_DISPLACEMENT && v->begun)
        return 0;
    *place = value;
    if (reference == BASE_ACCELERATION)
        v->device.base_slope = 0.0;
    if (reference == TERMINAL)
        v->device.terminal_slope = 0.0;
    if (reference >= START_DISPLACEMENT)
        harvester_start(&v->device, v->start[0], v->start[1], v->start[2]);
    return 1;
}

static int get(variables *v, unsigned reference, double *value)
{
    const harvester_device *d = &v->device;
    double *place = setting(v, reference);
    if (reference >= VARIABLES)
        return 0;
    if (place != NULL) {
        *value = *place;
        return 1;
    }
    switch (reference) {
    case TIME: *value = d->time; break;
    case OUTPUT: *value = harvester_output(d); break;
    case DISPLACEMENT: *value = harvester_displacement(d); break;
    case VELOCITY: *value = harvester_velocity(d); break;
    case ENERGY_INPUT: *value = d->state[HARVESTER_WORK]; break;
    case ENERGY_STORED: *value = harvester_stored_energy(d); break;
    case ENERGY_DAMPER: *value = d->state[HARVESTER_DAMPER]; break;
    case ENERGY_CONTACTS: *value = d->state[HARVESTER_CONTACTS]; break;
    case ENERGY_TRANSDUCER: *value = d->state[HARVESTER_OWN]; break;
    default: *value = d->state[HARVESTER_DELIVERED]; break;
    }
    return 1;
}

/* NULL, or what went wrong. Afterwards the inputs are held, until they are set again. */
static const char *step(variables *v, double time, double length)
{
    int outcome;
    if (!isfinite(time))
        return "the time is no number";
    v->begun = 1;
    v->device.time = time;
    outcome = harvester_advance(&v->device, time + length);
    v->device.base_slope = v->device.terminal_slope = 0.0;
    if (outcome == HARVESTER_NO_TIME)
        return "the step must be a number of seconds >= 0";
    if (outcome == HARVESTER_OUT_OF_RANGE)
        return "the displacement left the range in which the spring's force is known";
    if (outcome != HARVESTER_OK)
        return "the step became too short: look for inputs that are too great";
    return NULL;
}

#endif
