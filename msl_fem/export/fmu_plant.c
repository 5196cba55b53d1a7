/* The coupled model, see fmu_plant.h: what is printed from Python, called in turn. */
#include "fmu_plant.h"

#include <math.h>
#if SIDES > 0
#include "magnet_table.h"
#endif
#if PAIR
#include "shared_table.h"
#endif
#include "plant_functions.h"

#if PAIR
enum {
    N_POSITION = sizeof pair_shared_position_ / sizeof *pair_shared_position_,
    N_FIRST = sizeof pair_shared_current_1_ / sizeof *pair_shared_current_1_,
    N_SECOND = sizeof pair_shared_current_2_ / sizeof *pair_shared_current_2_
};
/* The cells of what both sides have in common, expanded before the first model begins; every model has the same. */
static double shared_cells[(N_POSITION - 1) * (N_FIRST - 1) * (N_SECOND - 1)][36 * PADDED];
static int expanded;
static const Cells cells = {
    magnet_table_gap_, magnet_table_current_, &magnet_table_coenergy_[0][0][0][0], MAGNET_TABLE_GAPS, MAGNET_TABLE_CURRENTS,
    {pair_shared_position_, pair_shared_current_1_, pair_shared_current_2_, &shared_cells[0][0], N_POSITION, N_FIRST, N_SECOND,
     PADDED}};
#elif SIDES > 0
static const Cells cells = {
    magnet_table_gap_, magnet_table_current_, &magnet_table_coenergy_[0][0][0][0], MAGNET_TABLE_GAPS, MAGNET_TABLE_CURRENTS};
#else
static const Cells cells = {0, 0, 0, 0, 0}; /* of a rig that a force drives: never looked at */
#endif
#if EFFECTS
#define WITH_EFFECTS state->coefficients,
#else
#define WITH_EFFECTS
#endif

#if EFFECTS
/* What effects and instruments do in steps of that size; 0 where a delay is longer than what is remembered. */
static int set_effects(const PlantParameters *p, PlantState *state, double step, long n_step)
{
    static const Instruments nothing;
    const double rate = 1.0 / (step * (double)n_step);
    KernelSetting setting;
    int n, late;
    Instruments *i = &state->instruments;
    for (n = 0; n < N_COEFFICIENT; ++n)
        state->coefficients[n] = 0.0;
    setting.plant = *p;
    setting.inductance = state->inductance;
    setting.step = step;
    setting.n_step = (double)n_step;
    effects_set_coefficients(state->coefficients, state->effect, &setting);
    *i = nothing;
    i->rate = rate;
    instruments_set_instruments(state->effect, rate, i->delay, i->polynomial, i->drift, i->hum);
    i->hum_frequency = instruments_hum_frequency(state->effect);
    late = state->coefficients[ELECTRICAL_DELAY_SAMPLES] >= N_QUEUE;
    for (n = 0; n < N_READING; ++n)
        late |= i->delay[n] > HISTORY_DEPTH - 2;
    return !late;
}

/* What the instruments read now. */
static void look_at_instruments(const PlantParameters *p, PlantState *state)
{
    static const double no_noise[N_READING];
    sampled_plant_remember_sample(p, state->coefficients, state->state, state->history, state->samples);
    instruments_read_sample(&state->instruments, SIDES, state->history, state->samples, no_noise, state->readings);
}
#endif

static void begin(const PlantParameters *p, PlantState *state, const double current[2], double position, double velocity)
{
    int n;
    for (n = 0; n < N_STATE; ++n)
        state->state[n] = 0.0;
    for (n = 0; n < N_WORK; ++n)
        state->work[n] = 0.0;
    state->work[CIRCUIT_2 + INDUCTANCE] = 1.0;
    state->step = 0.0;
    state->n_step = 0;
    layout_begin_at(p, state->state, current[0], current[1], position, velocity);
}

int plant_start(const PlantParameters *p, PlantState *state, const double current[2], double position, double velocity)
{
    double row[N_OUT];
#if PAIR
    if (!expanded)
        pair_shared_expand_all_(
            pair_shared_position_, pair_shared_current_1_, pair_shared_current_2_, pair_shared_nodes_, shared_cells);
    expanded = 1;
#endif
    begin(p, state, current, position, velocity);
#if EFFECTS
    {
        int n, m;
        state->samples = 0;
        state->inductance = 1.0;
#if SIDES > 0
        {
            double magnet[6];
            if (!magnet_table_evaluate(0.0, p->nominal_gap, magnet))
                return 0;
            state->inductance = MAGNETS * (CURRENT_SHARE * CURRENT_SHARE) * magnet[3];
        }
#endif
        for (n = 0; n < HISTORY_DEPTH; ++n)
            for (m = 0; m < N_HISTORY; ++m)
                state->history[n][m] = 0.0;
        (void)set_effects(p, state, 1.0, 1); /* what a start takes of them does not depend on the step */
        preparation_begin_effects(state->coefficients, state->state);
#if SIDES > 0
        if (state->coefficients[MAGNETIC_IRON_LOW] != 0.0 || state->coefficients[MAGNETIC_IRON_KNEE] != 0.0 ||
            state->coefficients[MAGNETIC_HYSTERESIS_STRETCH] != 0.0)
            preparation_share_with_iron(&cells, p, state->coefficients, state->state, state->work);
#endif
        step_look_at(state->coefficients, state->state, state->work);
        user_laws_set_added_reading(p, state->coefficients, state->state, state->work);
        look_at_instruments(p, state);
    }
#endif
    return plant_row(p, state, row);
}

int plant_row(const PlantParameters *p, PlantState *state, double *row)
{
    return kernel_write_row(&cells, p, WITH_EFFECTS state->state, state->work, row, 0, 1);
}

double plant_gap(const PlantParameters *p, const PlantState *state, int side)
{
#if SIDES > 0
    return side_side_gap(p, WITH_EFFECTS state->work, side);
#else
    (void)p, (void)state, (void)side;
    return (double)NAN;
#endif
}

double plant_force(const PlantParameters *p, PlantState *state, int side)
{
#if SIDES > 0
    return side_side_pull(&cells, p, WITH_EFFECTS state->work, side, state->state[I1 + side], plant_gap(p, state, side));
#else
    (void)p, (void)state, (void)side;
    return (double)NAN;
#endif
}

/* Whether timing, coefficients and instruments are those of steps of that size. */
static int is_timed(const PlantState *state, double step, long n_step)
{
    return state->n_step == n_step && fabs(step - state->step) <= 1e-9 * step;
}

int plant_advance(const PlantParameters *p, PlantState *state, const double command[2], double disturbance, double step,
                  long n_step)
{
    int status;
    if (!isfinite(disturbance))
        return NOT_FINITE;
    if (!is_timed(state, step, n_step)) {
#if EFFECTS
        if (state->n_step)
            return ANOTHER_STEP;
        if (!set_effects(p, state, step, n_step))
            return TOO_LATE;
        look_at_instruments(p, state);
#endif
        state->step = step;
        state->n_step = n_step;
        drive_set_timing(p, WITH_EFFECTS state->step, state->work);
    }
    status = kernel_advance_rows(&cells, p, WITH_EFFECTS state->state, state->work, command, disturbance, state->step,
                                 (int)n_step);
#if EFFECTS
    if (status == OK) {
        ++state->samples;
        look_at_instruments(p, state);
    }
#endif
    return status;
}
