/* FMI 3.0 for co-simulation around the coupled model: the interface alone, what it does stands in fmu_content.h.
 *
 * Value references are one list: the Float64 as in FMI 2.0, behind them the Int32, the Booleans, and time. */
#include "fmi3Functions.h"
#include "fmu_content.h"

#define FIRST_INT32 N_REAL
#define FIRST_BOOLEAN (FIRST_INT32 + N_INTEGER)
#define V_TIME (FIRST_BOOLEAN + N_BOOLEAN)

typedef struct {
    Content content;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Instance;

static fmi3Status complain(const Instance *self, const char *message)
{
    if (self->log)
        self->log(self->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

/* The instance where a function may be called in its present mode, else NULL, and said so. */
static Instance *called(fmi3Instance c, int modes, const char *function)
{
    Instance *self = (Instance *)c;
    char message[160];
    if (self == NULL)
        return NULL;
    if (self->content.mode & modes)
        return self;
    say_not_now(self->content.mode, function, message);
    (void)complain(self, message);
    return NULL;
}

static fmi3Status refuse(fmi3Instance c, const char *why)
{
    return c ? complain((const Instance *)c, why) : fmi3Error;
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)on, (void)n, (void)categories; /* errors alone are logged, and always */
    return called(c, ANY_MODE, "fmi3SetDebugLogging") ? fmi3OK : fmi3Error;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    Instance early, *self;
    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return, (void)intermediate, (void)update;
    memset(&early, 0, sizeof early);
    early.environment = environment;
    early.log = log;
    if (events || n_intermediate > 0) {
        (void)complain(&early, "there are neither events nor intermediate variables; outputs are there after a step");
        return NULL;
    }
    if (token == NULL || strcmp(token, MODEL_GUID) != 0) {
        (void)complain(&early, "the instantiation token is not that of this FMU, " MODEL_GUID
                               "; its model description is another's");
        return NULL;
    }
    self = (Instance *)calloc(1, sizeof *self);
    if (self == NULL) {
        (void)complain(&early, "no memory for an instance");
        return NULL;
    }
    memcpy(self, &early, sizeof early);
    put_start_values(&self->content);
    return self;
}

static fmi3Instance not_that_kind(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    if (log)
        log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation alone");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return not_that_kind(environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    return not_that_kind(environment, log);
}

void fmi3FreeInstance(fmi3Instance c)
{
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    Instance *self = called(c, INSTANTIATED, "fmi3EnterInitializationMode");
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop; /* the step is fixed, see largest_step */
    if (self == NULL)
        return fmi3Error;
    self->content.time = start;
    self->content.mode = INITIALISING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    Instance *self = called(c, INITIALISING, "fmi3ExitInitializationMode");
    const char *wrong;
    if (self == NULL)
        return fmi3Error;
    wrong = begin(&self->content);
    return wrong ? complain(self, wrong) : fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    Instance *self = called(c, STEPPING | FAILED, "fmi3Terminate");
    if (self == NULL)
        return fmi3Error;
    self->content.mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    Instance *self = called(c, ANY_MODE, "fmi3Reset");
    if (self == NULL)
        return fmi3Error;
    put_start_values(&self->content);
    return fmi3OK;
}

static fmi3Status unknown(const Instance *self, const char *what, fmi3ValueReference vr)
{
    char message[120];
    sprintf(message, "there is no %.40s with the value reference %u", what, (unsigned)vr);
    return complain(self, message);
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t n_value)
{
    Instance *self = called(c, ANY_MODE, "fmi3GetFloat64");
    size_t k;
    if (self == NULL || n_value < n)
        return fmi3Error;
    refresh(&self->content);
    for (k = 0; k < n; ++k) {
        if (vr[k] != V_TIME && vr[k] >= N_REAL)
            return unknown(self, "Float64", vr[k]);
        value[k] = vr[k] == V_TIME ? self->content.time : self->content.real[vr[k]];
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 value[], size_t n_value)
{
    Instance *self = called(c, ANY_MODE, "fmi3GetInt32");
    size_t k;
    if (self == NULL || n_value < n)
        return fmi3Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] < FIRST_INT32 || vr[k] >= FIRST_BOOLEAN)
            return unknown(self, "Int32", vr[k]);
        value[k] = self->content.integer[vr[k] - FIRST_INT32];
    }
    return fmi3OK;
}

fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean value[], size_t n_value)
{
    Instance *self = called(c, ANY_MODE, "fmi3GetBoolean");
    size_t k;
    if (self == NULL || n_value < n)
        return fmi3Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] < FIRST_BOOLEAN || vr[k] >= V_TIME)
            return unknown(self, "Boolean", vr[k]);
        value[k] = self->content.boolean[vr[k] - FIRST_BOOLEAN] != 0;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t n_value)
{
    Instance *self = called(c, INSTANTIATED | INITIALISING | STEPPING, "fmi3SetFloat64");
    const char *wrong;
    size_t k;
    if (self == NULL || n_value < n)
        return fmi3Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_REAL)
            return unknown(self, "Float64 that can be set", vr[k]);
        wrong = set_real(&self->content, vr[k], value[k]);
        if (wrong)
            return complain(self, wrong);
    }
    return fmi3OK;
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 value[],
                        size_t n_value)
{
    Instance *self = called(c, INSTANTIATED | INITIALISING | STEPPING, "fmi3SetInt32");
    (void)vr, (void)value, (void)n_value;
    if (self == NULL)
        return fmi3Error;
    return n == 0 ? fmi3OK : complain(self, "all Int32 are outputs, which cannot be set");
}

fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean value[],
                          size_t n_value)
{
    Instance *self = called(c, INSTANTIATED | INITIALISING, "fmi3SetBoolean");
    size_t k;
    if (self == NULL || n_value < n)
        return fmi3Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] < FIRST_BOOLEAN || vr[k] >= V_TIME)
            return unknown(self, "Boolean", vr[k]);
        self->content.boolean[vr[k] - FIRST_BOOLEAN] = value[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi3GetFMUState");
    if (self == NULL || kept == NULL)
        return fmi3Error;
    if (*kept == NULL)
        *kept = malloc(sizeof(Content));
    if (*kept == NULL)
        return complain(self, "no memory for a state");
    memcpy(*kept, &self->content, sizeof(Content));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState kept)
{
    Instance *self = called(c, ANY_MODE, "fmi3SetFMUState");
    if (self == NULL || kept == NULL)
        return fmi3Error;
    memcpy(&self->content, kept, sizeof(Content));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *kept)
{
    if (called(c, ANY_MODE, "fmi3FreeFMUState") == NULL)
        return fmi3Error;
    if (kept) {
        free(*kept);
        *kept = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState kept, size_t *size)
{
    if (called(c, ANY_MODE, "fmi3SerializedFMUStateSize") == NULL || kept == NULL)
        return fmi3Error;
    *size = MARK_SIZE + sizeof(Content);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState kept, fmi3Byte bytes[], size_t size)
{
    Instance *self = called(c, ANY_MODE, "fmi3SerializeFMUState");
    if (self == NULL || kept == NULL)
        return fmi3Error;
    if (size < MARK_SIZE + sizeof(Content))
        return complain(self, "the room for the serialized state is too small");
    put_bytes(kept, bytes);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi3DeserializeFMUState");
    if (self == NULL || kept == NULL)
        return fmi3Error;
    if (!are_ours(bytes, size))
        return complain(self, "the bytes are not a serialized state of this FMU");
    if (*kept == NULL)
        *kept = malloc(sizeof(Content));
    if (*kept == NULL)
        return complain(self, "no memory for a state");
    memcpy(*kept, bytes + MARK_SIZE, sizeof(Content));
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_way_back,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_time)
{
    Instance *self = called(c, STEPPING, "fmi3DoStep");
    char message[480];
    const char *wrong;
    (void)no_way_back;
    if (self == NULL)
        return fmi3Error;
    *event_needed = *terminate = *early_return = fmi3False;
    wrong = advance(&self->content, time, size, message);
    *last_time = self->content.time;
    return wrong ? complain(self, wrong) : fmi3OK;
}

#include "fmu_api3_refused.h"
