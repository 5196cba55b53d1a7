/* What an instance of the unit is, whatever the interface: variables, plant, state; and what its functions do with them.
 * No file is read, nothing is written. */
#ifndef FMU_CONTENT_H
#define FMU_CONTENT_H

#include "fmu_plant.h"
#include "fmu_variables.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define TWO_PI 6.283185307179586476925286766559

enum { INSTANTIATED = 1, INITIALISING = 2, STEPPING = 4, TERMINATED = 8, FAILED = 16 };
#define ANY_MODE (INSTANTIATED | INITIALISING | STEPPING | TERMINATED | FAILED)

/* What a kept state is: plain numbers, no pointers. */
typedef struct {
    int mode;
    double time;
    double real[N_REAL];
    int integer[N_INTEGER];
    int boolean[N_BOOLEAN];
    PlantParameters plant;
    PlantState state;
    char wrong[200]; /* with a parameter */
} Content;

static const char mark[8] = "msl_fem"; /* what serialized states begin with, then MODEL_GUID */
#define MARK_SIZE (sizeof mark + sizeof MODEL_GUID)

/* Why a function cannot be called in the present mode. */
static void say_not_now(int mode, const char *function, char message[160])
{
    sprintf(message, "%.40s cannot be called now: %s", function,
            mode == INSTANTIATED       ? "the instance is not initialised yet"
                : mode == INITIALISING ? "the instance is being initialised"
                : mode == STEPPING     ? "the simulation has begun"
                : mode == TERMINATED   ? "the simulation was terminated; reset the instance"
                                       : "the simulation has failed; reset the instance");
}

static double or_infinite(double value)
{
    return value > 0.0 ? value : (double)INFINITY;
}

#if EFFECTS
/* The parameters of effects into the state; NULL, or what is wrong with them. */
static const char *make_effects(Content *content)
{
    int n;
    for (n = 0; n < N_PARAMETER; ++n)
        content->state.effect[n] = effect_neutral[n];
    for (n = 0; n < N_EFFECT_VARIABLE; ++n) {
        const EffectVariable *v = &effect_variable[n];
        const double value = content->real[v->variable];
        if (value < v->low || value > v->high) {
            sprintf(content->wrong, "%.60s must be between %.6g and %.6g", v->name, v->low, v->high);
            return content->wrong;
        }
        if (v->lags && value != effect_neutral[v->index] && IDEAL_CURRENT_DRIVE(&content->plant)) {
            sprintf(content->wrong, "%.60s needs a drive whose current cannot jump; set drive_bandwidth", v->name);
            return content->wrong;
        }
        content->state.effect[v->index] = value;
    }
    return NULL;
}
#endif

/* The plant of the parameters; NULL, or what is wrong with them. */
static const char *make_plant(const Content *content, PlantParameters *p)
{
    const double *r = content->real;
    int n;
    for (n = 0; n < N_REAL; ++n)
        if (real_causality[n] == PARAMETER && !isfinite(r[n]))
            return "a parameter is not a finite number";
    if (!(r[V_MOVING_MASS] > 0.0))
        return "moving_mass must be above 0 kg";
    if (!(r[V_LARGEST_STEP] > 0.0))
        return "largest_step must be above 0 s";
    if (r[V_STIFFNESS] < 0.0 || r[V_DAMPING] < 0.0)
        return "stiffness and damping must not be negative";
    if (r[V_DRIVE_BANDWIDTH] < 0.0 || r[V_POSITION_SENSOR_BANDWIDTH] < 0.0)
        return "bandwidths must not be negative; 0 stands for an ideal part";
    if (r[V_END_STOP_RESTITUTION] < 0.0 || r[V_END_STOP_RESTITUTION] > 1.0)
        return "end_stop_restitution must be between 0 and 1";
    if (r[V_TRAVEL] < 0.0 || (content->boolean[V_END_STOP] && !(r[V_TRAVEL] > 0.0)))
        return "travel must be above 0 m where there are end stops, and never negative";
    p->mass = r[V_MOVING_MASS];
    p->stiffness = r[V_STIFFNESS];
    p->damping = r[V_DAMPING];
    p->constant_force = r[V_CONSTANT_FORCE];
    p->travel = or_infinite(r[V_TRAVEL]);
    p->end_stop.there = content->boolean[V_END_STOP];
    p->end_stop.position = p->travel;
    p->end_stop.restitution = r[V_END_STOP_RESTITUTION];
    p->bandwidth = or_infinite(TWO_PI * r[V_DRIVE_BANDWIDTH]);
    p->sensor_bandwidth = or_infinite(TWO_PI * r[V_POSITION_SENSOR_BANDWIDTH]);
    p->nominal_gap = p->voltage_limit = p->current_limit = (double)INFINITY;
    p->resistance = 0.0;
#if SIDES > 0
    if (!(r[V_NOMINAL_GAP] > 0.0) || (p->end_stop.there && !(r[V_NOMINAL_GAP] > r[V_TRAVEL])))
        return "nominal_gap must be positive and above the travel to an end stop";
    if (r[V_RESISTANCE] < 0.0 || r[V_VOLTAGE_LIMIT] < 0.0 || r[V_CURRENT_LIMIT] < 0.0)
        return "resistance and limits must not be negative; a limit of 0 stands for none";
    p->nominal_gap = r[V_NOMINAL_GAP];
    p->resistance = r[V_RESISTANCE];
    p->voltage_limit = or_infinite(r[V_VOLTAGE_LIMIT]);
    p->current_limit = or_infinite(r[V_CURRENT_LIMIT]);
#endif
    return NULL;
}

/* Plant and state of the present parameters; NULL, or what is wrong. */
static const char *make_start(Content *content)
{
    double current[2] = {0.0, 0.0};
    const char *wrong = make_plant(content, &content->plant);
    int j;
    if (wrong)
        return wrong;
    for (j = 0; j < SIDES; ++j) {
#if SIDES > 0
        current[j] = content->real[V_CURRENT_1_START + j];
#endif
    }
    if (fabs(content->real[V_POSITION_START]) > content->plant.travel)
        return "position_start lies outside the travel";
#if EFFECTS
    wrong = make_effects(content);
    if (wrong)
        return wrong;
#endif
    if (!plant_start(&content->plant, &content->state, current, content->real[V_POSITION_START],
                     content->real[V_VELOCITY_START]))
        return "the start lies outside the table of force and flux linkage: " TABLE_RECTANGLE;
    return NULL;
}

/* The outputs of the present state. */
static void write_outputs(Content *content)
{
    const double *s = content->state.state;
    double *r = content->real, row[N_OUT];
    (void)plant_row(&content->plant, &content->state, row);
    r[V_POSITION] = s[X];
    r[V_VELOCITY] = s[V];
#if EFFECTS
    r[V_POSITION_MEASURED] = content->state.readings[0];
#else
    r[V_POSITION_MEASURED] = s[SENSOR];
#endif
    r[V_ENERGY_ELECTRICAL] = s[ENERGY_ELECTRICAL];
    r[V_ENERGY_COPPER] = s[ENERGY_COPPER];
    r[V_ENERGY_DAMPING] = s[ENERGY_DAMPING];
    r[V_ENERGY_EXTERNAL] = s[ENERGY_EXTERNAL];
    r[V_ENERGY_IMPACT] = s[ENERGY_IMPACT];
#if SIDES > 0
    {
        int j;
        for (j = 0; j < SIDES; ++j) {
            r[V_CURRENT_1 + j] = row[OUT_I1 + j];
            r[V_VOLTAGE_1 + j] = content->state.work[MEAN_VOLTAGE_1 + j];
            r[V_FLUX_LINKAGE_1 + j] = row[OUT_FLUX_1 + j];
            r[V_FORCE_1 + j] = plant_force(&content->plant, &content->state, j);
            r[V_GAP_1 + j] = plant_gap(&content->plant, &content->state, j);
#if EFFECTS
            r[V_CURRENT_MEASURED_1 + j] = content->state.readings[1 + j];
#endif
            content->integer[V_STEPS_AT_CURRENT_LIMIT_1 + j] = (int)s[AT_CURRENT_LIMIT_1 + j];
            content->integer[V_STEPS_AT_VOLTAGE_LIMIT_1 + j] = (int)s[AT_VOLTAGE_LIMIT_1 + j];
        }
    }
#else
    r[V_DRIVE_FORCE] = content->state.work[MEAN_VOLTAGE_1];
#endif
}

static void put_start_values(Content *content)
{
    content->mode = INSTANTIATED;
    content->time = 0.0;
    memcpy(content->real, real_start, sizeof content->real);
    memset(content->integer, 0, sizeof content->integer);
    memcpy(content->boolean, boolean_start, sizeof content->boolean);
    (void)make_start(content);
    write_outputs(content);
}

/* Why the simulation cannot go on, with where it stands. */
static void explain(const Content *content, int status, char message[480])
{
    const PlantState *s = &content->state;
    const double elapsed = s->step * s->work[STEPS_DONE];
    char currents[64] = "";
    const char *said = status == OUTSIDE_TABLE ? "a gap or a current left the table of force and flux linkage ("
                                                 TABLE_RECTANGLE ")"
        : status == OUTSIDE_RANGE ? "the mover left its travel"
                                  : "an input or the state is no finite number";
    if (status == ANOTHER_STEP)
        strcpy(message, "with effects all communication steps are of one size, since delays are counted in them; "
                        "reset the instance to take another");
    else if (status == TOO_LATE)
        strcpy(message, "a delay of the effects is longer than the communication steps that are kept of it: "
                        TOO_LATE_SAID);
    if (status == ANOTHER_STEP || status == TOO_LATE)
        return;
    if (SIDES > 0)
        sprintf(currents, "i = %.6g, %.6g A, ", s->state[COIL_1], s->state[COIL_1 + 1]);
    sprintf(message,
            "%.200s after t = %.9g s, at %sx = %.6g m, x' = %.6g m/s; the simulation ends here, with the state of the "
            "last good step: command less, or control the position",
            said, content->time + elapsed, currents, s->state[X], s->state[V]);
}

/* One communication step; NULL, or why there is none: then the mode is FAILED where the model stopped. */
static const char *advance(Content *content, double time, double size, char message[480])
{
    double command[2] = {0.0, 0.0}, wanted = size / content->real[V_LARGEST_STEP];
    long n_step;
    int j, status;
    if (!(size > 0.0) || !(wanted <= 1e9))
        return "a communication step must be above 0 s and at most 1e9 times largest_step";
    n_step = (long)ceil(wanted - 1e-9);
    if (n_step < 1)
        n_step = 1;
    for (j = 0; j < CHANNELS; ++j)
        command[j] = content->real[V_COMMAND_1 + j];
    content->time = time;
    status = plant_advance(&content->plant, &content->state, command, content->real[V_DISTURBANCE],
                           size / (double)n_step, n_step);
    write_outputs(content);
    if (status != OK) {
        content->mode = FAILED;
        explain(content, status, message);
        return message;
    }
    content->time = time + size;
    ++content->integer[V_STEPS_DONE];
    return NULL;
}

/* The end of initialisation; NULL, or what is wrong with the parameters. */
static const char *begin(Content *content)
{
    const char *wrong = make_start(content);
    if (wrong) {
        content->mode = FAILED;
        return wrong;
    }
    write_outputs(content);
    content->mode = STEPPING;
    return NULL;
}

/* Before the simulation begins, outputs follow the start values as they are set. */
static void refresh(Content *content)
{
    if (content->mode & (INSTANTIATED | INITIALISING)) {
        (void)make_start(content);
        write_outputs(content);
    }
}

/* A Real that exists; NULL, or why it cannot be set now. */
static const char *set_real(Content *content, unsigned place, double value)
{
    if (real_causality[place] == OUTPUT)
        return "an output cannot be set";
    if (real_causality[place] == PARAMETER && content->mode == STEPPING)
        return "a parameter cannot be set once the simulation has begun; reset the instance";
    content->real[place] = value;
    return NULL;
}

/* A kept state as bytes, MARK_SIZE + sizeof(Content) of them, and back; 0 where they are another's. */
static void put_bytes(const void *kept, unsigned char *bytes)
{
    memcpy(bytes, mark, sizeof mark);
    memcpy(bytes + sizeof mark, MODEL_GUID, sizeof MODEL_GUID);
    memcpy(bytes + MARK_SIZE, kept, sizeof(Content));
}

static int are_ours(const unsigned char *bytes, size_t size)
{
    return size == MARK_SIZE + sizeof(Content) && memcmp(bytes, mark, sizeof mark) == 0
        && memcmp(bytes + sizeof mark, MODEL_GUID, sizeof MODEL_GUID) == 0;
}

#endif
