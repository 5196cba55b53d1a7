/* The coupled model of an actuator: circuits of the sides, drive, motion, end stops, instruments. SI units.
 *
 * All of it is printed from the Python functions of msl_fem.plant into plant_functions.h; what stands in fmu_plant.c
 * calls them.
 */
#ifndef FMU_PLANT_H
#define FMU_PLANT_H

#include "actuator.h"
#include "plant_records.h"

typedef struct {
    double state[N_STATE];  /* rows as in msl_fem.plant.layout */
    double work[N_WORK];
    double step;            /* s, that the timing is set for; 0 before the first call of plant_advance */
    long n_step;            /* of a communication step */
#if EFFECTS
    double effect[N_PARAMETER];      /* parameters of the catalogue of effects */
    double coefficients[N_COEFFICIENT];
    Instruments instruments;
    double history[HISTORY_DEPTH][N_HISTORY];
    double readings[N_READING];      /* before noise and resolution */
    double inductance;               /* of a side at the nominal gap without current, H */
    int samples;                     /* communication steps since the start */
#endif
} PlantState;

enum { ANOTHER_STEP = 100, TOO_LATE }; /* why plant_advance stops, beside the status of the kernel */

/* 0 where the start lies outside the table; with effects, state->effect is set before */
int plant_start(const PlantParameters *p, PlantState *state, const double current[2], double position, double velocity);

/* The columns of msl_fem.plant.layout, N_OUT, of the present state; 0 outside the table */
int plant_row(const PlantParameters *p, PlantState *state, double *row);

/* Gap (m), and force of a side's magnets (N), attractive positive */
double plant_gap(const PlantParameters *p, const PlantState *state, int side);
double plant_force(const PlantParameters *p, PlantState *state, int side);

/* OK, or why the model stopped, after n_step steps of `step` seconds; then the state is that of the last good step */
int plant_advance(const PlantParameters *p, PlantState *state, const double command[2], double disturbance, double step,
                  long n_step);

#endif
