"""
Compare with a filter
=====================

All methods take the same stances and return the same type, so that only the estimators differ.
"""

import matplotlib.pyplot as plt

import fg_nav

walk = fg_nav.simulate("demo", seed=1).recording
results = {name: fg_nav.navigate(walk, name) for name in ("smoother", "iez")}
for name, result in results.items():
    errors = result.metrics
    print(f"{name:8s} rmse {errors.rmse_2d_m:.2f} m horizontal, {errors.rmse_3d_m:.2f} m in space")

# %%
fig, axes = plt.subplots()
for name, result in results.items():
    axes.plot(result.t, result.position[:, 2], label=name)
axes.set(xlabel="time (s)", ylabel="height (m)")
axes.legend()
