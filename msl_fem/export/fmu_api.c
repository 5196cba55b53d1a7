/* FMI 2.0 for co-simulation around the coupled model: the interface alone, what it does stands in fmu_content.h. */
#include "fmi2Functions.h"
#include "fmu_content.h"

typedef struct {
    Content content;
    fmi2CallbackFunctions functions;
    char name[64];
} Instance;

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
    say_not_now(self->content.mode, function, message);
    (void)complain(self, message);
    return NULL;
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
    wrong = begin(&self->content);
    return wrong ? complain(self, wrong) : fmi2OK;
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
    refresh(&self->content);
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
    const char *wrong;
    size_t k;
    if (self == NULL)
        return fmi2Error;
    for (k = 0; k < n; ++k) {
        if (vr[k] >= N_REAL)
            return unknown(self, "Real", vr[k]);
        wrong = set_real(&self->content, vr[k], value[k]);
        if (wrong)
            return complain(self, wrong);
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
    put_bytes(kept, (unsigned char *)bytes);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *kept)
{
    Instance *self = called(c, ANY_MODE, "fmi2DeSerializeFMUstate");
    if (self == NULL || kept == NULL)
        return fmi2Error;
    if (!are_ours((const unsigned char *)bytes, size))
        return complain(self, "the bytes are not a serialized state of this FMU");
    if (*kept == NULL)
        *kept = self->functions.allocateMemory(1, sizeof(Content));
    if (*kept == NULL)
        return complain(self, "no memory for a state");
    memcpy(*kept, bytes + MARK_SIZE, sizeof(Content));
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_way_back)
{
    Instance *self = called(c, STEPPING, "fmi2DoStep");
    char message[480];
    const char *wrong;
    (void)no_way_back;
    if (self == NULL)
        return fmi2Error;
    wrong = advance(&self->content, time, size, message);
    return wrong ? complain(self, wrong) : fmi2OK;
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
