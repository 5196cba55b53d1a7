"""The coupled model: circuits of the sides, drive, motion and sensors as one compiled kernel, and what is done with it.

Open-loop runs (`simulate`), many runs with different parameters together (`run_lanes`), equilibria, linearisation and
stability, and records of simulated runs. `kernel` is the time loop itself, for closed loops that run compiled with it.
"""

from msl_fem.coupled_model.bearable import bearable_run, refused_unless_borne
from msl_fem.coupled_model.energy import EnergyAudit
from msl_fem.coupled_model.equilibrium import Equilibrium, equilibria, resting_point
from msl_fem.coupled_model.extended import check_effects, effect_coefficients
from msl_fem.coupled_model.inputs import Inputs, excitation_inputs
from msl_fem.coupled_model.lane_run import LaneRun, LaneSettings, run_lanes
from msl_fem.coupled_model.linearise import Linearisation, linearise
from msl_fem.coupled_model.open_loop import check_open_loop
from msl_fem.coupled_model.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.coupled_model.recording import NamedRun, simulation_record
from msl_fem.coupled_model.simulate import Options, Simulation, simulate
from msl_fem.coupled_model.stability import OpenLoopMap, open_loop_map, stability_limit
from msl_fem.coupled_model.static_map import static_map

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
