# %% [markdown]
# # From a magnet to its operating map
#
# The reference actuator of the package: its section, one field, a table of force and flux, and the currents up to which
# the iron works well. SI units throughout.

# %%
import numpy as np

import msl_fem

actuator = msl_fem.load_actuator("fast_tool_servo")
actuator

# %%
actuator.plot()

# %% [markdown]
# One field solution, with the error of the force estimated by one polynomial degree more.

# %%
point = msl_fem.solve(actuator, 2.0, 0.6e-3, accuracy="fast")
point

# %%
msl_fem.field_picture(actuator, 2.0, 0.6e-3, accuracy="fast")

# %% [markdown]
# A table over gap and current: every quantity is a derivative of one coenergy surface, and its errors are stated.

# %%
from msl_fem.magnetics.sweep.table_sweep import SweepSettings

gaps, currents = np.geomspace(0.15e-3, 1.1e-3, 6), np.linspace(0.0, 8.0, 10)
table, report = msl_fem.sweep(actuator, gaps, currents, settings=SweepSettings(accuracy="fast"))
table

# %%
table.plot()

# %%
table.to_pandas()[["force_N", "flux_linkage_Wb"]].tail(3)

# %% [markdown]
# The map: below the first curve the iron works in its linear part; above the last, current brings little more force.

# %%
limits = msl_fem.operating_map(table)
limits.plot()

# %%
msl_fem.Guard(limits).judge(4.0, 0.4e-3)
