/* The coupled model, see fmu_plant.h. */
#include "fmu_plant.h"

#include <math.h>
#if SIDES > 0
#include "magnet_table.h"
#endif

#define MOST_IMPACTS 50 /* in one step; the last one ends at rest */

enum { TARGET_1, TARGET_2, OUTPUT_1, OUTPUT_2, PUSH, N_INPUT };

/* One step's inputs at begin, middle and end, slopes of the four stages, the states reached, the sensor's weights */
typedef struct {
    double input[3][N_INPUT];
    double slope[4][N_INTEGRATED];
    double y[N_INTEGRATED];
    double weight[5];
    double output_end[2];
    int limited[2];
} Work;

double plant_gap(const Plant *p, double position, int side)
{
    return side == 0 ? p->nominal_gap - position : p->nominal_gap + position;
}

static double within(double value, double reach)
{
    return value > reach ? reach : value < -reach ? -reach : value;
}

/* Force (N), dlambda/di (H), dlambda/dgap (Wb/m) of a side at its current; 0 outside the table. */
static int side_slopes(int side, double current, double gap, double *pull, double *inductance, double *flux_slope)
{
    (void)side;
#if SIDES > 0
    double out[3];
    if (!magnet_table_slopes(CURRENT_SHARE * current, gap, out))
        return 0;
    *pull = MAGNETS * out[0];
    *inductance = MAGNETS * CURRENT_SHARE * CURRENT_SHARE * out[1];
    *flux_slope = -(MAGNETS * CURRENT_SHARE) * out[2]; /* dlambda/dgap = -dF/di */
    return 1;
#else
    (void)current, (void)gap;
    *pull = *inductance = *flux_slope = 0.0;
    return 1;
#endif
}

/* Flux linkage (Wb), force (N) and field energy (J) of a side at its current; 0 outside the table. */
static int side_values(double current, double gap, double *flux_linkage, double *force, double *energy)
{
#if SIDES > 0
    double out[6];
    if (!magnet_table_evaluate(CURRENT_SHARE * current, gap, out))
        return 0;
    *flux_linkage = MAGNETS * CURRENT_SHARE * out[1];
    *force = MAGNETS * out[2];
    *energy = *flux_linkage * current - MAGNETS * out[0];
    return 1;
#else
    (void)current, (void)gap;
    *flux_linkage = *force = *energy = 0.0;
    return 1;
#endif
}

int plant_side(const Plant *p, const PlantState *state, int side, double *flux_linkage, double *force)
{
    double energy;
    return side_values(state->y[I1 + side], plant_gap(p, state->y[X], side), flux_linkage, force, &energy);
}

void plant_start(const Plant *p, PlantState *state, const double current[2], double position, double velocity)
{
    int j;
    static const PlantState nothing;
    *state = nothing;
    state->y[X] = state->sensor = position;
    state->y[V] = velocity;
    for (j = 0; j < SIDES; ++j) {
        state->y[I1 + j] = current[j];
        if (DRIVE != FORCE_DRIVE)
            state->output[j] = p->resistance * current[j];
    }
}

/* Voltage and slope of the current of a side; `drop` is R i + lambda_g dg/dt. A current drive's inner loop knows the
 * coil: v = drop + L w (target - i), until v meets the voltage limit. */
static void terminal(const Plant *p, double current, double drop, double inductance, const double *input, int j,
                     double *voltage, double *slope, int *over)
{
    if (DRIVE != CURRENT_DRIVE) {
        *voltage = input[OUTPUT_1 + j];
        *slope = (*voltage - drop) / inductance;
    } else if (isinf(p->bandwidth)) {
        *voltage = drop;
        *slope = 0.0;
    } else {
        *slope = p->bandwidth * (input[TARGET_1 + j] - current);
        *voltage = drop + inductance * *slope;
        if (fabs(*voltage) > p->voltage_limit) {
            *voltage = *voltage < 0.0 ? -p->voltage_limit : p->voltage_limit;
            *slope = (*voltage - drop) / inductance;
            *over = 1;
        }
    }
}

/* The slopes of y under the inputs; 0 outside the table. */
static int rates(const Plant *p, Work *w, const double *input, double *dy)
{
    const double *y = w->y;
    double external = input[PUSH], force, electrical = 0.0, copper = 0.0;
    int j, inside = 1;
    dy[VOLT_SECONDS_1] = dy[VOLT_SECONDS_2] = dy[I1] = dy[I2] = 0.0;
    if (DRIVE == FORCE_DRIVE) {
        external += input[OUTPUT_1];
        dy[VOLT_SECONDS_1] = input[OUTPUT_1];
    }
    force = external;
    for (j = 0; j < SIDES; ++j) {
        const double toward = j == 0 ? 1.0 : -1.0, current = y[I1 + j];
        double pull = NAN, inductance = NAN, flux_slope = NAN, drop, voltage, slope;
        inside &= side_slopes(j, current, plant_gap(p, y[X], j), &pull, &inductance, &flux_slope);
        drop = p->resistance * current - flux_slope * toward * y[V];
        terminal(p, current, drop, inductance, input, j, &voltage, &slope, &w->limited[j]);
        force += toward * pull;
        electrical += voltage * current;
        copper += p->resistance * current * current;
        dy[I1 + j] = slope;
        dy[VOLT_SECONDS_1 + j] = voltage;
    }
    dy[X] = y[V];
    dy[V] = (force - p->damping * y[V] - p->stiffness * y[X]) / p->mass;
    dy[ENERGY_ELECTRICAL] = electrical;
    dy[ENERGY_COPPER] = copper;
    dy[ENERGY_DAMPING] = p->damping * y[V] * y[V];
    dy[ENERGY_EXTERNAL] = external * y[V];
    return inside;
}

/* `rates` of a stage; a mover that lies on an end stop does not move. */
static int slopes(const Plant *p, const PlantState *state, Work *w, int stage, int instant)
{
    const int inside = rates(p, w, w->input[instant], w->slope[stage]);
    if (state->held != 0.0)
        w->slope[stage][X] = w->slope[stage][V] = 0.0;
    return inside;
}

static void look_at(const PlantState *state, Work *w)
{
    int n;
    for (n = 0; n < N_INTEGRATED; ++n)
        w->y[n] = state->y[n];
}

/* The states after one step into w->y; 0 where a stage left the table. */
static int try_step(const Plant *p, const PlantState *state, Work *w, double step)
{
    int n, stage, inside = 1;
    look_at(state, w);
    for (stage = 0; stage < 4; ++stage) {
        if (stage > 0) {
            const double share = stage == 3 ? step : 0.5 * step;
            for (n = 0; n < N_INTEGRATED; ++n)
                w->y[n] = state->y[n] + share * w->slope[stage - 1][n];
        }
        inside &= slopes(p, state, w, stage, (stage + 1) / 2);
    }
    for (n = 0; n < N_INTEGRATED; ++n) {
        const double middle = w->slope[1][n] + w->slope[2][n];
        w->y[n] = state->y[n] + step / 6.0 * (w->slope[0][n] + 2.0 * middle + w->slope[3][n]);
    }
    return inside;
}

/* Weights of (y0, x0, x0', x1, x1') in y1 for y' = w (x - y), x a cubic over the step: exact at any bandwidth. */
static void lag_weights(double bandwidth, double step, double weight[5])
{
    const double z = bandwidth * step, decay = exp(-z);
    double i_0, i_1, i_2, i_3;
    if (z > 1.0) {
        i_0 = 1.0 - decay;
        i_1 = 1.0 - i_0 / z;
        i_2 = 1.0 - 2.0 * i_1 / z;
        i_3 = 1.0 - 3.0 * i_2 / z;
    } else {
        int k;
        i_3 = 0.0;
        for (k = 20; k > 3; --k)
            i_3 = z / k * (1.0 - i_3);
        i_2 = z / 3.0 * (1.0 - i_3);
        i_1 = z / 2.0 * (1.0 - i_2);
        i_0 = z * (1.0 - i_1);
    }
    weight[0] = decay;
    weight[1] = i_0 - 3.0 * i_2 + 2.0 * i_3;
    weight[2] = step * (i_1 - 2.0 * i_2 + i_3);
    weight[3] = 3.0 * i_2 - 2.0 * i_3;
    weight[4] = step * (i_3 - i_2);
}

/* Makes w->y the state, and carries on what is known in closed form. */
static void keep_step(PlantState *state, const Work *w)
{
    int n;
    state->sensor = w->weight[0] * state->sensor + w->weight[1] * state->y[X] + w->weight[2] * state->y[V]
        + (w->weight[3] * w->y[X] + w->weight[4] * w->y[V]);
    for (n = 0; n < N_INTEGRATED; ++n)
        state->y[n] = w->y[n];
    for (n = 0; n < 2; ++n)
        state->output[n] = w->output_end[n];
}

/* A trial over `part` of the step after `done` of it; inputs are those of the whole step, a parabola each. */
static int try_part(const Plant *p, const PlantState *state, Work *w, double kept[3][N_INPUT], double done, double part,
                    double step)
{
    int n, k;
    for (n = 0; n < N_INPUT; ++n) {
        const double a = kept[0][n], b = 4.0 * kept[1][n] - 3.0 * a - kept[2][n];
        const double curvature = 2.0 * (a - 2.0 * kept[1][n] + kept[2][n]);
        for (k = 0; k < 3; ++k) {
            const double s = done + 0.5 * k * part;
            w->input[k][n] = a + s * (b + s * curvature);
        }
    }
    return try_step(p, state, w, part * step);
}

/* The part of the step after which the mover touches its stop on that side, w->y there; -1 if it never does. Newton's
 * iteration, kept between a share that does not reach the stop and one that does, or that leaves the table. */
static double contact(const Plant *p, const PlantState *state, Work *w, double kept[3][N_INPUT], double done,
                      double part, double step, double side)
{
    double low = 0.0, high = part, share = 0.5 * part;
    int n;
    for (n = 0; n < 200; ++n) {
        const int inside = try_part(p, state, w, kept, done, share, step);
        const double beyond = side * w->y[X] - p->travel;
        if (inside && (fabs(beyond) <= 1e-14 * p->travel || high - low <= 1e-15)) {
            w->y[X] = side * p->travel;
            return share;
        }
        if (!inside || beyond > 0.0)
            high = share;
        else
            low = share;
        share -= beyond / (side * w->y[V] * step);
        if (!(inside && low < share && share < high))
            share = 0.5 * (low + high);
    }
    return -1.0;
}

static double sign(double value)
{
    return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

/* Turns the velocity round at the stop, or ends it there where the mover would be back within one step. */
static void bounce(const Plant *p, PlantState *state, Work *w, double step, int last)
{
    const double before = state->y[V];
    double after = -p->restitution * before, outward;
    look_at(state, w);
    (void)slopes(p, state, w, 0, 2);
    outward = w->slope[0][V] * sign(state->y[X]);
    if (last || (outward > 0.0 && 2.0 * fabs(after) < outward * step)) {
        after = 0.0;
        state->held = sign(state->y[X]);
    }
    state->y[V] = after;
    state->energy_impact += 0.5 * p->mass * (before * before - after * after);
}

/* Lets a mover go that nothing presses to its stop any more. */
static void release(const Plant *p, PlantState *state, Work *w)
{
    if (state->held != 0.0) {
        const double side = state->held;
        state->held = 0.0;
        look_at(state, w);
        (void)slopes(p, state, w, 0, 0);
        if (w->slope[0][V] * side > 0.0)
            state->held = side;
    }
}

/* One step through all impacts; 0 outside the table. */
static int step_with_stop(const Plant *p, PlantState *state, Work *w, double step)
{
    double kept[3][N_INPUT], done = 0.0;
    int n, k, impacts = 0, inside;
    release(p, state, w);
    inside = try_step(p, state, w, step);
    if (inside && fabs(w->y[X]) <= p->travel) {
        keep_step(state, w);
        return 1;
    }
    for (k = 0; k < 3; ++k)
        for (n = 0; n < N_INPUT; ++n)
            kept[k][n] = w->input[k][n];
    inside = 1;
    while (inside && done < 1.0) {
        double part = 1.0 - done;
        inside = try_part(p, state, w, kept, done, part, step);
        if (!inside || fabs(w->y[X]) > p->travel) {
            const double side = sign(inside ? w->y[X] : state->y[V]);
            part = contact(p, state, w, kept, done, part, step, side);
            inside = part >= 0.0;
            ++impacts;
        }
        if (inside) {
            lag_weights(p->sensor_bandwidth, part * step, w->weight);
            keep_step(state, w);
            if (fabs(state->y[X]) >= p->travel && state->held == 0.0)
                bounce(p, state, w, step, impacts >= MOST_IMPACTS);
            done = part < 1.0 - done ? done + part : 1.0;
        }
    }
    lag_weights(p->sensor_bandwidth, step, w->weight);
    return inside;
}

/* Why a step to w->y cannot stand, or OK. */
static int judge(const Plant *p, const Work *w, int inside)
{
    int n;
    for (n = 0; n < N_INTEGRATED; ++n)
        if (!isfinite(w->y[n]))
            return inside ? NOT_FINITE : OUTSIDE_TABLE;
    if (!inside)
        return OUTSIDE_TABLE;
    return fabs(w->y[X]) > p->travel ? OUTSIDE_RANGE : OK;
}

static int take_step(const Plant *p, PlantState *state, Work *w, double step)
{
    int status;
    if (p->end_stop)
        return judge(p, w, step_with_stop(p, state, w, step));
    status = judge(p, w, try_step(p, state, w, step));
    if (status == OK)
        keep_step(state, w);
    return status;
}

/* The commands, clipped at the drive's limit and counted there; 0 where one is no number. */
static int take_command(const Plant *p, PlantState *state, const double wanted[2], double taken[2])
{
    int j;
    for (j = 0; j < CHANNELS; ++j) {
        taken[j] = wanted[j];
        if (!isfinite(taken[j]))
            return 0;
        if (DRIVE == CURRENT_DRIVE) {
            state->at_current_limit[j] += fabs(taken[j]) > p->current_limit;
            taken[j] = within(taken[j], p->current_limit);
        } else if (DRIVE == VOLTAGE_DRIVE) {
            state->at_voltage_limit[j] += fabs(taken[j]) > p->voltage_limit;
            state->at_current_limit[j] += fabs(state->y[I1 + j]) > p->current_limit;
            taken[j] = within(taken[j], p->voltage_limit);
        }
    }
    return 1;
}

/* Sets currents or outputs of an ideal drive to the commands, at constant gap; 0 outside the table. */
static int jump(const Plant *p, PlantState *state, const double command[2])
{
    int j;
    for (j = 0; j < CHANNELS; ++j) {
        state->output[j] = command[j];
        if (DRIVE == CURRENT_DRIVE) {
            const double gap = plant_gap(p, state->y[X], j);
            double before, after, force, stored_before, stored;
            if (!side_values(state->y[I1 + j], gap, &before, &force, &stored_before)
                || !side_values(command[j], gap, &after, &force, &stored))
                return 0;
            state->y[VOLT_SECONDS_1 + j] += after - before;
            state->y[ENERGY_ELECTRICAL] += stored - stored_before;
            state->y[I1 + j] = command[j];
        }
    }
    return 1;
}

/* What stands for a fall exp(-z s) at begin, middle and end of a step, and what is left behind it (fall_rows). */
static void fall_values(double z, double fall[4])
{
    const double last = exp(-z), m_0 = (1.0 - last) / z, m_1 = (m_0 - last) / z, m_2 = (2.0 * m_1 - last) / z;
    const int slow = !(z > 0.1);
    fall[0] = slow ? 1.0 : 6.0 * (m_0 - 3.0 * m_1 + 2.0 * m_2);
    fall[1] = slow ? exp(-0.5 * z) : 6.0 * (m_1 - m_2);
    fall[2] = slow ? last : 6.0 * (2.0 * m_2 - m_1);
    fall[3] = last;
}

/* Inputs of one step: commands and forces held, outputs of a voltage or force drive on their way to the commands. */
static void act(const PlantState *state, Work *w, const double command[2], double push, const double fall[4])
{
    int j, k;
    for (j = 0; j < 2; ++j) {
        const int lags = DRIVE != CURRENT_DRIVE && j < CHANNELS;
        const double away = state->output[j] - command[j];
        for (k = 0; k < 3; ++k) {
            w->input[k][TARGET_1 + j] = command[j];
            w->input[k][OUTPUT_1 + j] = lags ? command[j] + fall[k] * away : state->output[j];
        }
        w->output_end[j] = lags ? command[j] + fall[3] * away : state->output[j];
    }
    for (k = 0; k < 3; ++k)
        w->input[k][PUSH] = push;
}

int plant_advance(const Plant *p, PlantState *state, const double command[2], double disturbance, double step, long n_step)
{
    static const Work nothing;
    Work w = nothing;
    const int ideal = isinf(p->bandwidth) != 0;
    double taken[2] = {0.0, 0.0}, fall[4];
    long done = 0;
    int j, status;
    state->y[VOLT_SECONDS_1] = state->y[VOLT_SECONDS_2] = 0.0;
    lag_weights(p->sensor_bandwidth, step, w.weight);
    fall_values(p->bandwidth * step, fall);
    status = take_command(p, state, command, taken) && isfinite(disturbance) ? OK : NOT_FINITE;
    if (status == OK && ideal)
        status = jump(p, state, taken) ? OK : OUTSIDE_TABLE;
    while (done < n_step && status == OK) {
        act(state, &w, taken, disturbance + p->constant_force, fall);
        status = take_step(p, state, &w, step);
        done += status == OK;
    }
    state->elapsed = (double)done * step;
    for (j = 0; j < 2; ++j) {
        state->voltage[j] = state->y[VOLT_SECONDS_1 + j] / ((double)(done > 0 ? done : 1) * step);
        if (DRIVE == CURRENT_DRIVE)
            state->at_voltage_limit[j] += (ideal && fabs(state->voltage[j]) > p->voltage_limit) || w.limited[j];
    }
    return status;
}
