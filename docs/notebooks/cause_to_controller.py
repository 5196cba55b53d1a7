# %% [markdown]
# # From a cause to a controller that knows it
#
# What a diagnosis found is handed to the design: here a gap that is 30 µm wider on side 1 than the drawing says. The
# same controller is designed without and with that knowledge, and both run on the plant that has it.

# %%
import msl_fem
from msl_fem.control import ControllerChoice, PlantUnderTest, design_model_with_effects, designed
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation, reference

actuator = msl_fem.load_actuator("fast_tool_servo")
table = msl_fem.read_table("fast_tool_servo")  # a table of the package
limits = msl_fem.operating_map(table)
found = EffectValues({"gap_offset": {"offset": 30e-6}})

# %%
plain = msl_fem.design_controller(actuator, table, limits)
informed = designed(design_model_with_effects(actuator, table, limits, found), ControllerChoice())

# %%
sine = parse_excitation("sine:frequency=5 Hz,amplitude=0.1 mm,duration=0.4 s,loop=closed")
track = reference(sine, rate=actuator.controller.rate)
plant = PlantUnderTest(actuator, table, found)
designs = {"plain": plain, "informed": informed}
runs = {name: msl_fem.run_closed_loop(design, track, plant=plant) for name, design in designs.items()}
runs["plain"]

# %%
runs["plain"].plot()

# %%
runs["informed"].plot()

# %%
{name: f"{1e6 * run.tracking_rms:.3g} µm RMS" for name, run in runs.items()}
