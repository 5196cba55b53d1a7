"""The coupled model: circuits of the sides, drive, motion and sensors as one compiled kernel, and what is done with it.

Open-loop runs (`simulate`), many runs with different parameters together (`run_lanes`), equilibria, linearisation and
stability, and records of simulated runs. `kernel` is the time loop itself, for closed loops that run compiled with it.
"""

from msl_fem.plant.energy import EnergyAudit
from msl_fem.plant.excitation import Inputs, excitation_inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import LaneRun, run_lanes
from msl_fem.plant.linearisation import Linearisation, linearise
from msl_fem.plant.open_loop import bearable_run, check_open_loop, refused_unless_borne
from msl_fem.plant.operating_point import (
    Equilibrium,
    OpenLoopMap,
    equilibria,
    open_loop_map,
    resting_point,
    stability_limit,
)
from msl_fem.plant.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.preparation import check_effects, effect_coefficients
from msl_fem.plant.simulate import NamedRun, Options, Simulation, simulate, simulation_record
from msl_fem.plant.static_map import static_map

__all__ = [
    "EnergyAudit",
    "Equilibrium",
    "Inputs",
    "LaneRun",
    "LaneSettings",
    "Linearisation",
    "NamedRun",
    "OpenLoopMap",
    "Options",
    "PlantParameters",
    "Simulation",
    "Surface",
    "bearable_run",
    "check_effects",
    "check_open_loop",
    "effect_coefficients",
    "equilibria",
    "excitation_inputs",
    "linearise",
    "open_loop_map",
    "plant_parameters",
    "refused_unless_borne",
    "resting_point",
    "run_lanes",
    "simulate",
    "simulation_record",
    "stability_limit",
    "static_map",
    "surface_of",
]
