/* FMI 2.0 for co-simulation around the coupled model of fmu_plant.h. No file is read, nothing is written. */
#include "fmi2Functions.h"
#include "fmu_plant.h"
#include "fmu_variables.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define TWO_PI 6.283185307179586476925286766559

enum { INSTANTIATED = 1, INITIALISING = 2, STEPPING = 4, TERMINATED = 8, FAILED = 16 };
#define ANY_MODE (INSTANTIATED | INITIALISING | STEPPING | TERMINATED | FAILED)

/* What fmi2GetFMUstate copies: plain numbers, no pointers. */
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

typedef struct {
    Content content;
    fmi2CallbackFunctions functions;
    char name[64];
} Instance;

static const char mark[8] = "msl_fem"; /* what serialized states begin with, then MODEL_GUID */
#define MARK_SIZE (sizeof mark + sizeof MODEL_GUID)

static fmi2Status complain(const Instance *self, const char *message)
{
    if (self->functions.logger)
        self->functions.logger(self->functions.componentEnvironment, self->name, fmi2Error, "logStatusError", message);
    return fmi2Error;
}

/* The instance where a function may be called in its present mode, else NULL, and said so. */
static Instance *called(fmi2Component c, int modes, const char *function)
{
    Instance *self = (Instance *)c;
    char message[160];
    if (self == NULL)
        return NULL;
    if (self->content.mode & modes)
        return self;
    sprintf(message, "%.40s cannot be called now: %s", function,
            self->content.mode == INSTANTIATED       ? "the instance is not initialised yet"
                : self->content.mode == INITIALISING ? "the instance is being initialised"
                : self->content.mode == STEPPING     ? "the simulation has begun"
                : self->content.mode == TERMINATED   ? "the simulation was terminated; reset the instance"
                                                     : "the simulation has failed; reset the instance");
    (void)complain(self, message);
    return NULL;
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

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *self, early;
    (void)resources, (void)visible, (void)logging;
    if (functions == NULL)
        return NULL;
    memset(&early, 0, sizeof early);
    early.functions = *functions;
    sprintf(early.name, "%.63s", name ? name : "");
    if (functions->allocateMemory == NULL || functions->freeMemory == NULL) {
        (void)complain(&early, "allocateMemory and freeMemory are needed");
        return NULL;
    }
    if (type != fmi2CoSimulation) {
        (void)complain(&early, "this FMU is for co-simulation alone");
        return NULL;
    }
    if (guid == NULL || strcmp(guid, MODEL_GUID) != 0) {
        (void)complain(&early, "the GUID is not that of this FMU, " MODEL_GUID "; its model description is another's");
        return NULL;
    }
    self = (Instance *)functions->allocateMemory(1, sizeof *self);
    if (self == NULL) {
        (void)complain(&early, "no memory for an instance");
        return NULL;
    }
    memcpy(self, &early, sizeof early);
    put_start_values(&self->content);
    return self;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *self = (Instance *)c;
    if (self)
        self->functions.freeMemory(self);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)on, (void)n, (void)categories; /* errors alone are logged, and always */
    return called(c, ANY_MODE, "fmi2SetDebugLogging") ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    Instance *self = called(c, INSTANTIATED, "fmi2SetupExperiment");
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop; /* the step is fixed, see largest_step */
    if (self == NULL)
        return fmi2Error;
    self->content.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *self = called(c, INSTANTIATED, "fmi2EnterInitializationMode");
    if (self == NULL)
        return fmi2Error;
    self->content.mode = INITIALISING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *self = called(c, INITIALISING, "fmi2ExitInitializationMode");
    const char *wrong;
    if (self == NULL)
        return fmi2Error;
    wrong = make_start(&self->content);
    if (wrong) {
        self->content.mode = FAILED;
        return complain(self, wrong);
    }
    write_outputs(&self->content);
    self->content.mode = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Instance *self = called(c, STEPPING | FAILED, "fmi2Terminate");
    if (self == NULL)
        return fmi2Error;
    self->content.mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *self = called(c, ANY_MODE, "fmi2Reset");
    if (self == NULL)
        return fmi2Error;
    put_start_values(&self->content);
    return fmi2OK;
}

/* Before the simulation begins, outputs follow the start values as they are set. */
static void refresh(Instance *self)
{
    if (self->content.mode & (INSTANTIATED | INITIALISING)) {
        (void)make_start(&self->content);
        write_outputs(&self->content);
    }
}

static fmi2Status unknown(const Instance *self, const char *what, fmi2ValueReference vr)
{
    char message[120];
    sprintf(message, "there is no %.40s with the value reference %u", what, vr);
    return complain(self, message);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetReal");
    size_t k;
    if (self == NULL)
        return fmi2Error;
    refresh(self);
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_REAL)
            return unknown(self, "Real", vr[k]);
        value[k] = self->content.real[vr[k]];
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetInteger");
    size_t k;
    if (self == NULL)
        return fmi2Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_INTEGER)
            return unknown(self, "Integer", vr[k]);
        value[k] = self->content.integer[vr[k]];
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetBoolean");
    size_t k;
    if (self == NULL)
        return fmi2Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_BOOLEAN)
            return unknown(self, "Boolean", vr[k]);
        value[k] = self->content.boolean[vr[k]] ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetString");
    (void)value;
    if (self == NULL)
        return fmi2Error;
    return n == 0 ? fmi2OK : unknown(self, "String", vr[0]);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Instance *self = called(c, INSTANTIATED | INITIALISING | STEPPING, "fmi2SetReal");
    size_t k;
    if (self == NULL)
        return fmi2Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_REAL)
            return unknown(self, "Real", vr[k]);
        if (real_causality[vr[k]] == OUTPUT)
            return complain(self, "an output cannot be set");
        if (real_causality[vr[k]] == PARAMETER && self->content.mode == STEPPING)
            return complain(self, "a parameter cannot be set once the simulation has begun; reset the instance");
        self->content.real[vr[k]] = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    Instance *self = called(c, INSTANTIATED | INITIALISING | STEPPING, "fmi2SetInteger");
    (void)vr, (void)value;
    if (self == NULL)
        return fmi2Error;
    return n == 0 ? fmi2OK : complain(self, "all Integers are outputs, which cannot be set");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    Instance *self = called(c, INSTANTIATED | INITIALISING, "fmi2SetBoolean");
    size_t k;
    if (self == NULL)
        return fmi2Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_BOOLEAN)
            return unknown(self, "Boolean", vr[k]);
        self->content.boolean[vr[k]] = value[k] != fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    Instance *self = called(c, INSTANTIATED | INITIALISING | STEPPING, "fmi2SetString");
    (void)value;
    if (self == NULL)
        return fmi2Error;
    return n == 0 ? fmi2OK : unknown(self, "String", vr[0]);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi2GetFMUstate");
    if (self == NULL || kept == NULL)
        return fmi2Error;
    if (*kept == NULL)
        *kept = self->functions.allocateMemory(1, sizeof(Content));
    if (*kept == NULL)
        return complain(self, "no memory for a state");
    memcpy(*kept, &self->content, sizeof(Content));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate kept)
{
    Instance *self = called(c, ANY_MODE, "fmi2SetFMUstate");
    if (self == NULL || kept == NULL)
        return fmi2Error;
    memcpy(&self->content, kept, sizeof(Content));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi2FreeFMUstate");
    if (self == NULL)
        return fmi2Error;
    if (kept && *kept) {
        self->functions.freeMemory(*kept);
        *kept = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate kept, size_t *size)
{
    if (called(c, ANY_MODE, "fmi2SerializedFMUstateSize") == NULL || kept == NULL)
        return fmi2Error;
    *size = MARK_SIZE + sizeof(Content);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate kept, fmi2Byte bytes[], size_t size)
{
    Instance *self = called(c, ANY_MODE, "fmi2SerializeFMUstate");
    if (self == NULL || kept == NULL)
        return fmi2Error;
    if (size < MARK_SIZE + sizeof(Content))
        return complain(self, "the room for the serialized state is too small");
    memcpy(bytes, mark, sizeof mark);
    memcpy(bytes + sizeof mark, MODEL_GUID, sizeof MODEL_GUID);
    memcpy(bytes + MARK_SIZE, kept, sizeof(Content));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi2DeSerializeFMUstate");
    if (self == NULL || kept == NULL)
        return fmi2Error;
    if (size != MARK_SIZE + sizeof(Content) || memcmp(bytes, mark, sizeof mark) != 0
        || memcmp(bytes + sizeof mark, MODEL_GUID, sizeof MODEL_GUID) != 0)
        return complain(self, "the bytes are not a serialized state of this FMU");
    if (*kept == NULL)
        *kept = self->functions.allocateMemory(1, sizeof(Content));
    if (*kept == NULL)
        return complain(self, "no memory for a state");
    memcpy(*kept, bytes + MARK_SIZE, sizeof(Content));
    return fmi2OK;
}

/* Why the simulation cannot go on, with where it stands. */
static fmi2Status explain(Instance *self, int status)
{
    const Content *content = &self->content;
    const PlantState *s = &content->state;
    const double elapsed = s->step * s->work[STEPS_DONE];
    char message[480], currents[64] = "";
    const char *said = status == OUTSIDE_TABLE ? "a gap or a current left the table of force and flux linkage ("
                                                 TABLE_RECTANGLE ")"
        : status == OUTSIDE_RANGE ? "the mover left its travel"
                                  : "an input or the state is no finite number";
    if (status == ANOTHER_STEP)
        return complain(self, "with effects all communication steps are of one size, since delays are counted in them; "
                              "reset the instance to take another");
    if (status == TOO_LATE)
        return complain(self, "a delay of the effects is longer than the communication steps that are kept of it: "
                              TOO_LATE_SAID);
    if (SIDES > 0)
        sprintf(currents, "i = %.6g, %.6g A, ", s->state[COIL_1], s->state[COIL_1 + 1]);
    sprintf(message,
            "%.200s after t = %.9g s, at %sx = %.6g m, x' = %.6g m/s; the simulation ends here, with the state of the "
            "last good step: command less, or control the position",
            said, content->time + elapsed, currents, s->state[X], s->state[V]);
    return complain(self, message);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_way_back)
{
    Instance *self = called(c, STEPPING, "fmi2DoStep");
    Content *content;
    double command[2] = {0.0, 0.0}, wanted;
    long n_step;
    int j, status;
    (void)no_way_back;
    if (self == NULL)
        return fmi2Error;
    content = &self->content;
    wanted = size / content->real[V_LARGEST_STEP];
    if (!(size > 0.0) || !(wanted <= 1e9))
        return complain(self, "a communication step must be above 0 s and at most 1e9 times largest_step");
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
        return explain(self, status);
    }
    content->time = time + size;
    ++content->integer[V_STEPS_DONE];
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    Instance *self = called(c, ANY_MODE, "fmi2CancelStep");
    return self ? complain(self, "steps end before fmi2DoStep returns; there is none to cancel") : fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2SetRealInputDerivatives");
    (void)vr, (void)n, (void)order, (void)value;
    return self ? complain(self, "inputs are held over a step; derivatives are not taken") : fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetRealOutputDerivatives");
    (void)vr, (void)n, (void)order, (void)value;
    return self ? complain(self, "derivatives of outputs are not given") : fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknown,
                                        const fmi2ValueReference knowns[], size_t n_known, const fmi2Real d_known[],
                                        fmi2Real d_unknown[])
{
    Instance *self = called(c, ANY_MODE, "fmi2GetDirectionalDerivative");
    (void)unknowns, (void)n_unknown, (void)knowns, (void)n_known, (void)d_known, (void)d_unknown;
    return self ? complain(self, "directional derivatives are not given") : fmi2Error;
}

static fmi2Status no_status(fmi2Component c)
{
    Instance *self = called(c, ANY_MODE, "fmi2GetStatus");
    if (self)
        (void)complain(self, "steps are never pending; there is no status to ask for");
    return self ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    Instance *self = called(c, ANY_MODE, "fmi2GetRealStatus");
    if (self && kind == fmi2LastSuccessfulTime) {
        *value = self->content.time;
        return fmi2OK;
    }
    return no_status(c);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    Instance *self = called(c, ANY_MODE, "fmi2GetBooleanStatus");
    if (self && kind == fmi2Terminated) {
        *value = self->content.mode == TERMINATED ? fmi2True : fmi2False;
        return fmi2OK;
    }
    return no_status(c);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind, (void)value;
    return no_status(c);
}
