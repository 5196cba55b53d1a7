# %% [markdown]
# # From a record to its cause
#
# Forces measured over gap and current, in a data frame as a bench writes it; somewhere the rig is not as believed.
# The data are simulated here: the gap is 25 µm wider than the drawing says, which the diagnosis is not told.

# %%
import numpy as np
import pandas as pd

import msl_fem
from msl_fem.diagnosis import DiagnosisSettings
from msl_fem.record import FrameLabels, Noise

actuator = msl_fem.load_actuator("fast_tool_servo")
table = msl_fem.read_table("fast_tool_servo")  # a table of the package

# %%
hidden = 25e-6  # m
g, i = (grid.ravel() for grid in np.meshgrid(np.linspace(0.2e-3, 0.9e-3, 8), np.linspace(0.5, 6.0, 12)))
draw = np.random.default_rng(7)
frame = pd.DataFrame({"gap_m": g, "current_A": i + 1e-3 * draw.standard_normal(g.size)})
frame["force_N"] = table.force(i, g + hidden) + 0.02 * draw.standard_normal(g.size)
frame["flux_linkage_Wb"] = table.evaluate(i, g + hidden)["flux_linkage"] + 2e-6 * draw.standard_normal(g.size)
frame["role"] = np.where(np.arange(g.size) % 3 == 2, "held-out", "fit")
frame.head(3)

# %%
noise = Noise(force=0.02, flux_linkage=2e-6, current=1e-3)
labels = FrameLabels(noise=noise, static_gap="mover")  # the gaps follow from the mover's position
record = msl_fem.record_from_frames(actuator, static=frame, labels=labels)
record

# %%
record.plot()

# %% [markdown]
# The diagnosis fits what is believed within its tolerances first, then tries the effects of its catalogue. It names one
# only where the evidence is beyond what chance brings, and held-out rows agree.

# %%
verdict = msl_fem.diagnose(record, DiagnosisSettings(table=table))
verdict

# %%
verdict.plot()

# %%
[(cause.effect, dict(cause.parameters)) for cause in verdict.causes]
