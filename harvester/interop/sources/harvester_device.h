/*
 * A vibration energy harvester, stepped from one exchange of inputs to the next; SI units.
 *
 *     harvester_device device;
 *     harvester_reset(&device);                   the scene's own start
 *     device.base_acceleration = ...;             m/s^2, what drives the mass, at device.time
 *     device.terminal = ...;                      A out of a piezo, or V across a coil
 *     if (harvester_advance(&device, time) != 0)  0: the device is at `time`, not before device.time
 *         ...
 *     voltage = harvester_output(&device);
 *
 * Both inputs go on from device.time in straight lines of the slopes given beside them.
 */
#ifndef HARVESTER_DEVICE_H
#define HARVESTER_DEVICE_H

enum {
    HARVESTER_DISPLACEMENT, /* over the length unit */
    HARVESTER_VELOCITY,     /* over the length unit, 1/s */
    HARVESTER_STATE,        /* V of a piezo, A of a coil with inductance */
    HARVESTER_WORK,         /* J, put in by the base; the next four: where it went */
    HARVESTER_DAMPER,
    HARVESTER_CONTACTS,
    HARVESTER_OWN,          /* leak or winding */
    HARVESTER_DELIVERED,    /* out of the terminals, into load_resistance as well */
    HARVESTER_STATES
};

/* What harvester_advance returns. */
enum { HARVESTER_OK, HARVESTER_STUCK, HARVESTER_OUT_OF_RANGE, HARVESTER_NO_TIME };

typedef struct {
    double time;              /* s */
    double base_acceleration; /* m/s^2 */
    double base_slope;        /* m/s^3 */
    double terminal;          /* A or V */
    double terminal_slope;    /* A/s or V/s */
    double load_resistance;   /* ohm: across a piezo, in series with a coil; 0: none */
    double step;              /* s, the step to be tried next */
    double start_energy;      /* J, stored at the beginning */
    double held_speed;        /* with which the contact began, over the length unit */
    double state[HARVESTER_STATES];
    int zone;                 /* between which contacts the mass is */
} harvester_device;

void harvester_reset(harvester_device *device);
/* Displacement (m), velocity (m/s) and V or A; the energies begin at zero. */
void harvester_start(harvester_device *device, double displacement, double velocity, double state);
int harvester_advance(harvester_device *device, double time);

double harvester_displacement(const harvester_device *device); /* m */
double harvester_velocity(const harvester_device *device);     /* m/s */
double harvester_output(const harvester_device *device);       /* V of a piezo, A of a coil */
double harvester_stored_energy(const harvester_device *device); /* J, since the beginning */

#endif
