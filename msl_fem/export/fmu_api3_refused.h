/* What FMI 3.0 has and this unit has not: each function says so. Included by fmu_api3.c alone. */

#define NO_VARIABLES(Type)                                                                                          \
    fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type value[], size_t m) \
    {                                                                                                               \
        (void)vr, (void)n, (void)value, (void)m;                                                                    \
        return refuse(c, "there is no " #Type "; the types are Float64, Int32 and Boolean");                        \
    }                                                                                                               \
    fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Type value[],     \
                             size_t m)                                                                              \
    {                                                                                                               \
        (void)vr, (void)n, (void)value, (void)m;                                                                    \
        return refuse(c, "there is no " #Type "; the types are Float64, Int32 and Boolean");                        \
    }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(String)

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences, size_t
    valueSizes[], fmi3Binary values[], size_t nValues)
{
    (void)valueReferences, (void)nValueReferences, (void)valueSizes, (void)values, (void)nValues;
    return refuse(c, "there is no variable of that type; the types are Float64, Int32 and Boolean");
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Clock
    values[])
{
    (void)valueReferences, (void)nValueReferences, (void)values;
    return refuse(c, "there is no variable of that type; the types are Float64, Int32 and Boolean");
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
    size_t valueSizes[], const fmi3Binary values[], size_t nValues)
{
    (void)valueReferences, (void)nValueReferences, (void)valueSizes, (void)values, (void)nValues;
    return refuse(c, "there is no variable of that type; the types are Float64, Int32 and Boolean");
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
    fmi3Clock values[])
{
    (void)valueReferences, (void)nValueReferences, (void)values;
    return refuse(c, "there is no variable of that type; the types are Float64, Int32 and Boolean");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference valueReference, size_t*
    nDependencies)
{
    (void)valueReference, (void)nDependencies;
    return refuse(c, "dependencies are those of the model description");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t
    elementIndicesOfDependent[], fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
    fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    (void)dependent, (void)elementIndicesOfDependent, (void)independents, (void)elementIndicesOfIndependents,
        (void)dependencyKinds, (void)nDependencies;
    return refuse(c, "dependencies are those of the model description");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns, const
    fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
    size_t nSensitivity)
{
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns, (void)seed, (void)nSeed, (void)sensitivity,
        (void)nSensitivity;
    return refuse(c, "derivatives are not given");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns, const
    fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
    size_t nSensitivity)
{
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns, (void)seed, (void)nSeed, (void)sensitivity,
        (void)nSensitivity;
    return refuse(c, "derivatives are not given");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    return refuse(c, "there is nothing to configure");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    return refuse(c, "there is nothing to configure");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences, (void)nValueReferences, (void)intervals, (void)qualifiers;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions, (void)qualifiers;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Float64 shifts[])
{
    (void)valueReferences, (void)nValueReferences, (void)shifts;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    const fmi3Float64 intervals[])
{
    (void)valueReferences, (void)nValueReferences, (void)intervals;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    const fmi3Float64 shifts[])
{
    (void)valueReferences, (void)nValueReferences, (void)shifts;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean* discreteStatesNeedUpdate, fmi3Boolean*
    terminateSimulation, fmi3Boolean* nominalsOfContinuousStatesChanged, fmi3Boolean* valuesOfContinuousStatesChanged,
    fmi3Boolean* nextEventTimeDefined, fmi3Float64* nextEventTime)
{
    (void)discreteStatesNeedUpdate, (void)terminateSimulation, (void)nominalsOfContinuousStatesChanged,
        (void)valuesOfContinuousStatesChanged, (void)nextEventTimeDefined, (void)nextEventTime;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean*
    enterEventMode, fmi3Boolean* terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint, (void)enterEventMode, (void)terminateSimulation;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    (void)time;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    (void)continuousStates, (void)nContinuousStates;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 derivatives[], size_t nContinuousStates)
{
    (void)derivatives, (void)nContinuousStates;
    return refuse(c, "derivatives are not given");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    (void)eventIndicators, (void)nEventIndicators;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    (void)continuousStates, (void)nContinuousStates;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t nContinuousStates)
{
    (void)nominals, (void)nContinuousStates;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t* nEventIndicators)
{
    (void)nEventIndicators;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t* nContinuousStates)
{
    (void)nContinuousStates;
    return refuse(c, "this FMU is for co-simulation alone");
}

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    return refuse(c, "the step mode follows the initialisation; there are no events to come back from");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
{
    (void)valueReferences, (void)nValueReferences, (void)orders, (void)values, (void)nValues;
    return refuse(c, "derivatives are not given");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clockReference, fmi3Float64 activationTime)
{
    (void)clockReference, (void)activationTime;
    return refuse(c, "there are neither clocks nor events; a step is made by fmi3DoStep");
}
