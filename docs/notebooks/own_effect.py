# %% [markdown]
# # An effect of one's own
#
# A law in a line becomes part of the plant: here the drag of the air, which no effect of the catalogue is. It is
# simulated by the same compiled kernel, and `diagnose`, `control` and the FMU take it as well.

# %%
import numpy as np

import msl_fem
from msl_fem.computing.laws import causes_of
from msl_fem.plant.effects import stated_causes

actuator = msl_fem.load_actuator("fast_tool_servo")
table = msl_fem.read_table("fast_tool_servo")  # a table of the package
drag = stated_causes(causes_of("drag: force = -a*v*abs(v); a: 400 in 0..1000 N s2/m2"))

# %%
inputs = msl_fem.excitation_inputs(actuator, "step:amplitude=0.1 A,bias=0.3 A,duration=0.12 s", rate=10e3)
plain = msl_fem.simulate(actuator, table, inputs)
with_drag = msl_fem.simulate(actuator, table, inputs, effects=drag)
with_drag

# %%
with_drag.plot()

# %% [markdown]
# What the drag changes, as a frame: the two positions beside each other.

# %%
both = plain.to_pandas()[["position_m"]]
both["position_m_drag"] = with_drag.to_pandas()["position_m"]
both.iloc[::300]

# %%
late = both.iloc[-300:]
swing = late.max() - late.min()
assert swing["position_m_drag"] < swing["position_m"], "the drag takes energy"
np.round(1e6 * swing, 2)
