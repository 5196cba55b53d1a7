/* The coupled model of an actuator: circuits of the sides, drive, motion, end stops, position sensor. SI units.
 *
 *     v_j = R i_j + d lambda_j(i_j, g_j)/dt,   g_1 = g_0 - x,   g_2 = g_0 + x
 *     m x'' + c x' + k x = F_1(i_1, g_1) - F_2(i_2, g_2) + F_const + d(t)
 *
 * lambda and F are derivatives of one coenergy; a side of n equal magnets, each with the share s of the side's current,
 * has the coenergy n W'(s i, g). Classical Runge-Kutta scheme with a fixed step.
 */
#ifndef FMU_PLANT_H
#define FMU_PLANT_H

#include "actuator.h"

enum { CURRENT_DRIVE = 0, VOLTAGE_DRIVE = 1, FORCE_DRIVE = 2 };
enum { OK = 0, OUTSIDE_TABLE = 1, NOT_FINITE = 2, OUTSIDE_RANGE = 3 };
enum {
    I1, I2, X, V, ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPING, ENERGY_EXTERNAL, VOLT_SECONDS_1, VOLT_SECONDS_2,
    N_INTEGRATED
};

/* INFINITY switches a bandwidth or a limit off */
typedef struct {
    double mass, stiffness, damping, constant_force, nominal_gap, travel, restitution;
    double resistance, bandwidth, voltage_limit, current_limit, sensor_bandwidth;
    int end_stop; /* whether there is one, at the travel */
} Plant;

typedef struct {
    double y[N_INTEGRATED];      /* what is integrated */
    double sensor, output[2];    /* position behind its sensor, the drive's outputs (V or N) */
    double held, energy_impact;  /* the end stop that the mover lies on (-1, 0, 1), J lost at the stops */
    double elapsed;              /* by how much the last call of plant_advance got on, s */
    double voltage[2];           /* mean over the last call of plant_advance, V (or N of a force drive) */
    int at_current_limit[2], at_voltage_limit[2]; /* calls of plant_advance in which a limit was met */
} PlantState;

/* What magnets of a side give: flux linkage (Wb), force (N), attractive positive; 0 outside the table */
int plant_side(const Plant *p, const PlantState *state, int side, double *flux_linkage, double *force);
double plant_gap(const Plant *p, double position, int side);
void plant_start(const Plant *p, PlantState *state, const double current[2], double position, double velocity);

/* OK, or why the model stopped, after n_step steps of `step` seconds; then the state is that of the last good step */
int plant_advance(const Plant *p, PlantState *state, const double command[2], double disturbance, double step, long n_step);

#endif
