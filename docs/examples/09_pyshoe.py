"""
PyShoe's motion-captured trials
===============================

The trials of PyShoe (https://github.com/utiasSTARS/pyshoe) have their truth in the same file: put ``FG_NAV_DATA`` to
where their folder ``vicon`` is. Without it the picture has the errors of all trials, as `scripts/measure.py` stored
them.
"""

import json
import os
from pathlib import Path

import matplotlib.pyplot as plt

import fg_nav

trials = sorted(Path(os.environ.get("FG_NAV_DATA", "data"), "vicon").rglob("*.mat"))
if trials:
    result = fg_nav.navigate(trials[0])
    print(f"{trials[0].name}: rmse {result.metrics.rmse_2d_m:.3f} m")
    axes = result.plot()
else:
    print("PyShoe's data are not at hand where this was built.")

# %%
# All trials with the stances of PyShoe's labels: each step of a line is one of them.
docs = Path(__file__).resolve().parents[1] if "__file__" in globals() else Path("..")  # not known in the gallery
stored = json.loads((docs / "results/real-walks.json").read_text(encoding="utf-8"))
fig, axes = plt.subplots()
for name in ("inertial", "iez"):
    rows = [row for row in stored["rows"] if (row["section"], row["variant"]) == ("vicon, labels", name)]
    axes.step(sorted(row["rmse_2d_m"] for row in rows), range(1, len(rows) + 1), where="post", label=name)
axes.set(
    xlabel="rmse over the ground (m)",
    ylabel="trials below",
    title="{date}, commit {commit}".format(**stored["made"]["vicon, labels"]),
)
axes.legend()
