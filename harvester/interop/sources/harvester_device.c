/*
 * Dormand and Prince's Runge-Kutta method of order 5(4) with steps by its error estimate. Contacts
 * begin and end at the end of a step, found to rounding, so that the force within a step is smooth.
 */
#include "harvester_device.h"

#include <math.h>
#include <string.h>

#include "equations.h"

typedef struct {
    double rate;   /* of the transducer's state */
    double force;  /* N against the motion */
    double power;  /* W out of the terminals */
    double work;   /* W that the base puts in here */
    double loss;   /* W in the transducer itself */
    double output; /* V or A */
} terminals;

/* `base` is the base's acceleration (m/s^2). */
static terminals terminals_of(double velocity, double state, double input, double resistance,
                              double base)
{
    terminals now;
    now.work = 0.0;
#if defined(PIEZO)
    /* The state is what the capacitance holds; modes left out add a charge with the base. */
    double voltage = state - BASE_CHARGE * base / CAPACITANCE;
    double current = input + (resistance > 0.0 ? voltage / resistance : 0.0);
    now.output = voltage;
    now.force = COUPLING * voltage;
    now.loss = LEAK * voltage * voltage;
    now.power = voltage * current;
    now.rate = (COUPLING * velocity - LEAK * voltage - current) / CAPACITANCE;
    now.work = BASE_CHARGE * base * now.rate;
#elif defined(COIL)
    double voltage = input + resistance * state;
    now.output = state;
    now.force = COUPLING * state;
    now.loss = WINDING * state * state;
    now.power = state * voltage;
    now.rate = (COUPLING * velocity - WINDING * state - voltage) / INDUCTANCE;
#else /* a coil without inductance: the current follows at once */
    double current = (COUPLING * velocity - input) / (WINDING + resistance);
    now.output = current;
    now.force = COUPLING * current;
    now.loss = WINDING * current * current;
    now.power = current * (input + resistance * current);
    now.rate = 0.0;
#endif
    (void)state, (void)base;
    return now;
}

/* Error of a step over the value or its unit. */
#define TOLERANCE 1e-9
#define MOST_STEPS 10000000L
#define LEAST_STEP 1e-14

#define ENERGY_UNIT (MASS * LENGTH * LENGTH)

/* The forces of contacts are asked for within their contact only. */
static int acts(int k, int zone)
{
    if (SIDES[k] >= 0.0 && EDGES[zone] >= GAPS[k])
        return 1;
    if (SIDES[k] <= 0.0 && EDGES[zone + 1] <= -GAPS[k])
        return -1;
    return 0;
}

static double reaction(int zone, double held, double x, double u, double *loss)
{
    double force = 0.0;
    int k;
    *loss = 0.0;
    for (k = 0; k < CONTACTS; k++) {
        int side = acts(k, zone);
        if (side != 0) {
            double inside = side * fmax(side * x, GAPS[k]);
            double push = contact_force(k, inside, u, held);
            force += push;
            *loss += (push - contact_force(k, inside, 0.0, held)) * u;
        }
    }
    return force;
}

/* Elastic energy of all contacts, by Gauss and Legendre in the root of the depth. */
static double contact_energy(double x)
{
    static const double nodes[] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                                   0.9602898564975363};
    static const double weights[] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                     0.1012285362903763};
    double energy = 0.0;
    int k, node;
    for (k = 0; k < CONTACTS; k++) {
        double side = SIDES[k] != 0.0 ? SIDES[k] : (x < 0.0 ? -1.0 : 1.0);
        double depth = side * x - GAPS[k];
        for (node = 0; node < 8 && depth > 0.0; node++) {
            double root = 0.5 * (1.0 + (node < 4 ? 1.0 : -1.0) * nodes[node % 4]);
            double force = contact_force(k, side * (GAPS[k] + depth * root * root), 0.0, 1.0);
            energy += weights[node % 4] * depth * root * side * force;
        }
    }
    return energy;
}

static double stored_energy(const double y[])
{
    double x = y[HARVESTER_DISPLACEMENT], u = y[HARVESTER_VELOCITY], state = y[HARVESTER_STATE];
    return ENERGY_UNIT * (0.5 * u * u + spring_energy(x) + contact_energy(x)) +
           STATE_ENERGY * state * state;
}

static void rates(const harvester_device *d, double time, const double y[], double dy[])
{
    double since = time - d->time, x = y[HARVESTER_DISPLACEMENT], u = y[HARVESTER_VELOCITY];
    double acceleration = d->base_acceleration + d->base_slope * since;
    double base = acceleration / EXCITATION_UNIT;
    double loss, contact = reaction(d->zone, d->held_speed, x, u, &loss);
    double drag = damper_force(u);
    terminals now = terminals_of(LENGTH * u, y[HARVESTER_STATE],
                                 d->terminal + d->terminal_slope * since, d->load_resistance,
                                 acceleration);
    dy[HARVESTER_DISPLACEMENT] = u;
    dy[HARVESTER_VELOCITY] = base - drag - spring_force(x) - contact - now.force / (MASS * LENGTH);
    dy[HARVESTER_STATE] = now.rate;
    dy[HARVESTER_WORK] = ENERGY_UNIT * base * u + now.work;
    dy[HARVESTER_DAMPER] = ENERGY_UNIT * drag * u;
    dy[HARVESTER_CONTACTS] = ENERGY_UNIT * loss;
    dy[HARVESTER_OWN] = now.loss;
    dy[HARVESTER_DELIVERED] = now.power;
}

/* One step from `y` to `end`; returns its error over the tolerance. */
static double try_step(const harvester_device *d, double time, const double y[], double h,
                       double end[])
{
    static const double shares[] = {0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0};
    static const double a[7][6] = {
        {0.0},
        {0.2},
        {3.0 / 40.0, 9.0 / 40.0},
        {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
        {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
        {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
        {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0}};
    static const double differences[] = {71.0 / 57600.0,      0.0,          -71.0 / 16695.0,
                                         71.0 / 1920.0,       -17253.0 / 339200.0,
                                         22.0 / 525.0,        -1.0 / 40.0};
    static const double units[] = {1.0, RATE, STATE_UNIT};
    double k[7][HARVESTER_STATES], worst = 0.0;
    int stage, i, j;
    for (stage = 0; stage < 7; stage++) {
        for (i = 0; i < HARVESTER_STATES; i++) {
            double sum = 0.0;
            for (j = 0; j < stage; j++)
                sum += a[stage][j] * k[j][i];
            end[i] = y[i] + h * sum;
        }
        rates(d, time + shares[stage] * h, end, k[stage]);
    }
    for (i = 0; i <= HARVESTER_STATE; i++) {
        double error = 0.0;
        for (j = 0; j < 7; j++)
            error += differences[j] * k[j][i];
        error = fabs(h * error) / (TOLERANCE * (units[i] + fabs(end[i])));
        if (!(error <= worst)) /* also where it is no number */
            worst = error;
    }
    return worst;
}

/* The side, +1 or -1, on which a step leaves its zone; *h is shortened where it turns beyond. */
static int leaves(const harvester_device *d, const double y[], const double end[], double *h)
{
    double low = EDGES[d->zone], high = EDGES[d->zone + 1], x = y[HARVESTER_DISPLACEMENT];
    double v = y[HARVESTER_VELOCITY], x1 = end[HARVESTER_DISPLACEMENT];
    double v1 = end[HARVESTER_VELOCITY];
    if (x1 > high || x1 < low)
        return x1 > high ? 1 : -1;
    if (v * v1 < 0.0) {
        /* Where the cubic through both ends turns. */
        double u = v / (v - v1), w = 1.0 - u, rise = x1 - x;
        double turn = x + rise * u + u * w * ((*h * v - rise) * w + (rise - *h * v1) * u);
        if (turn > high || turn < low)
            *h *= u;
    }
    return 0;
}

/* The step that ends on the edge, by regula falsi (Illinois); `end` beyond it becomes its end. */
static double landing(const harvester_device *d, double time, const double y[], double h, int side,
                      double end[])
{
    double edge = EDGES[side > 0 ? d->zone + 1 : d->zone], low = 0.0, high = h;
    double below = side * (y[HARVESTER_DISPLACEMENT] - edge);
    double above = side * (end[HARVESTER_DISPLACEMENT] - edge);
    int round, last = 0;
    for (round = 0; round < 100 && high - low > 1e-15 * h && above > 1e-15; round++) {
        double middle = low - below * (high - low) / (above - below), now;
        if (!(middle > low && middle < high))
            middle = 0.5 * (low + high);
        try_step(d, time, y, middle, end);
        now = side * (end[HARVESTER_DISPLACEMENT] - edge);
        if (now > 0.0) {
            high = middle;
            above = now;
            below *= last > 0 ? 0.5 : 1.0;
            last = 1;
        } else {
            low = middle;
            below = now;
            above *= last < 0 ? 0.5 : 1.0;
            last = -1;
            if (now >= -1e-15) {
                high = middle;
                break;
            }
        }
    }
    try_step(d, time, y, high, end);
    end[HARVESTER_DISPLACEMENT] = edge;
    return high;
}

static void enter(harvester_device *d, int side)
{
    if (EDGES[d->zone] < 0.0 && EDGES[d->zone + 1] > 0.0)
        d->held_speed = fabs(d->state[HARVESTER_VELOCITY]);
    d->zone += side;
}

static double next_step(double h, double error)
{
    return h * fmin(5.0, fmax(0.2, 0.9 * pow(error + 1e-30, -0.2)));
}

int harvester_advance(harvester_device *d, double stop)
{
    double time = d->time, y[HARVESTER_STATES], end[HARVESTER_STATES], h = 0.0;
    long count;
    int retried = 0;
    if (!(stop - d->time >= 0.0) || !isfinite(stop))
        return HARVESTER_NO_TIME;
    for (count = 0; time < stop; count++) {
        double rest = stop - time, tried, error;
        int side, on_edge;
        if (!retried)
            h = d->step < rest ? d->step : rest;
        if (count > MOST_STEPS || !(h > LEAST_STEP * d->step))
            return HARVESTER_STUCK;
        tried = h;
        memcpy(y, d->state, sizeof y);
        error = try_step(d, time, y, h, end);
        retried = 1;
        if (!(error <= 1.0)) {
            d->step = h = error < 1e30 ? next_step(h, error) : 0.2 * h;
            continue;
        }
        side = leaves(d, y, end, &h);
        if (h < tried)
            continue;
        on_edge = side != 0 && y[HARVESTER_DISPLACEMENT] == EDGES[side > 0 ? d->zone + 1 : d->zone];
        if (on_edge && side * y[HARVESTER_VELOCITY] < 0.0 && h * RATE > 1e-12) {
            /* It came in over this edge: the step back out must begin within the zone. */
            h *= 0.5;
            continue;
        }
        if (side != 0)
            h = landing(d, time, y, h, side, end);
        memcpy(d->state, end, sizeof end);
        if (side != 0) {
            enter(d, side);
        } else if (h < d->step) {
            d->step = fmax(d->step, next_step(h, error));
        } else {
            d->step = next_step(h, error);
        }
        if (end[HARVESTER_DISPLACEMENT] < LOWEST || end[HARVESTER_DISPLACEMENT] > HIGHEST)
            return HARVESTER_OUT_OF_RANGE;
        time = h >= rest ? stop : time + h;
        retried = 0;
    }
    d->base_acceleration += d->base_slope * (stop - d->time);
    d->terminal += d->terminal_slope * (stop - d->time);
    d->time = stop;
    return HARVESTER_OK;
}

void harvester_start(harvester_device *d, double displacement, double velocity, double state)
{
    double x = displacement / LENGTH, u = velocity / LENGTH;
    memset(d->state, 0, sizeof d->state);
    d->state[HARVESTER_DISPLACEMENT] = x;
    d->state[HARVESTER_VELOCITY] = u;
    d->state[HARVESTER_STATE] = state;
    d->start_energy = stored_energy(d->state);
    d->step = 1e-3 / RATE;
    d->held_speed = sqrt(u * u + 2.0 * contact_energy(x));
    d->zone = 0;
    while (EDGES[d->zone + 1] < x || (EDGES[d->zone + 1] == x && x < 0.0))
        d->zone++;
}

void harvester_reset(harvester_device *d)
{
    memset(d, 0, sizeof *d);
    harvester_start(d, START_DISPLACEMENT, START_VELOCITY, START_STATE);
}

double harvester_displacement(const harvester_device *d)
{
    return LENGTH * d->state[HARVESTER_DISPLACEMENT];
}

double harvester_velocity(const harvester_device *d)
{
    return LENGTH * d->state[HARVESTER_VELOCITY];
}

double harvester_output(const harvester_device *d)
{
    return terminals_of(harvester_velocity(d), d->state[HARVESTER_STATE], d->terminal,
                        d->load_resistance, d->base_acceleration).output;
}

double harvester_stored_energy(const harvester_device *d)
{
    return stored_energy(d->state) - d->start_energy;
}
