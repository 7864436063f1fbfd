"""
A first walk
============

From a recording to a path. The recording is simulated here; ``fg_nav.read("walk.csv")`` reads one of your own, in
any of the formats of :doc:`/formats`.
"""

import fg_nav

recording = fg_nav.simulate("demo", seed=1).recording
result = fg_nav.navigate(recording)
print(result)
print("verdict:", result.verdict.word)

# %%
# The frame is east, north, up from the first footfall, and a row is a footfall with its standard deviations.
print(result.to_dataframe("footfalls")[["time_s", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m"]].tail(3))

# %%
# From above, with the ellipses that hold 95 %. ``result.save("mine")`` writes all of it into a folder.
axes = result.plot()
