"""
Arrays and data frames of your own
==================================

Samples in any units pass the checks of a file. What is left out is noted, what cannot be a walk is refused in one
sentence; the picture shows the stances around the missing sample.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import fg_nav

walk = fg_nav.simulate("demo", seed=1).recording
ms, acc_g, gyr_deg_s = walk.t * 1e3, walk.acc / 9.80665, np.degrees(walk.gyr)
recording = fg_nav.Recording.from_arrays(ms, acc_g, gyr_deg_s, walk.mag, units="ms, g, deg/s, uT")

# %%
# A data frame is read by the names of its columns. Here a sample is missing.
frame = pd.DataFrame(np.column_stack([ms, acc_g, gyr_deg_s]), columns=["t", "ax", "ay", "az", "gx", "gy", "gz"])
frame.loc[4000, "ay"] = np.nan
recording = fg_nav.Recording.from_dataframe(frame, units="ms, g, deg/s")
print(*recording.provenance.notes, sep="\n")

t, stances = recording.t, fg_nav.detect_stances(recording)
fig, axes = plt.subplots()
axes.plot(t, np.linalg.norm(recording.acc, axis=1), linewidth=1)
for start, stop in zip(stances.start, stances.stop, strict=True):
    axes.axvspan(t[start], t[stop - 1], color="0.85")
axes.axvline(walk.t[4000], color="C1")
axes.set(xlim=walk.t[4000] + np.array([-4, 4]), xlabel="time (s)", ylabel="specific force (m/s²), stances in grey")

# %%
# Units that cannot be are named.
try:
    fg_nav.Recording.from_arrays(walk.t, acc_g, walk.gyr)
except fg_nav.FgNavError as error:
    print(error)
