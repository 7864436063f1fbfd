"""
Arrays and data frames of your own
==================================

Samples in whatever units they have go through the checks of a file: what is left out of them is said, and what cannot
be walked with is refused in a sentence.
"""

import numpy as np
import pandas as pd

import fg_nav

walk = fg_nav.simulate("demo", seed=1).recording
ms, acc_g, gyr_deg_s = walk.t * 1e3, walk.acc / 9.80665, np.degrees(walk.gyr)

recording = fg_nav.Recording.from_arrays(ms, acc_g, gyr_deg_s, walk.mag, units="ms, g, deg/s, uT")
print(len(recording), "samples at", round(1 / recording.period_s), "Hz")

# %%
# A data frame is read by the names of its columns. Here a sample is missing.
frame = pd.DataFrame(np.column_stack([ms, acc_g, gyr_deg_s]), columns=["t", "ax", "ay", "az", "gx", "gy", "gz"])
frame.loc[4000, "ay"] = np.nan
recording = fg_nav.Recording.from_dataframe(frame, units="ms, g, deg/s")
print(*recording.provenance.notes, sep="\n")

# %%
# Units that cannot be are named.
try:
    fg_nav.Recording.from_arrays(walk.t, acc_g, walk.gyr)
except fg_nav.FgNavError as error:
    print(error)
