"""
Two lines on PyShoe's data
==========================

The motion-captured trials of PyShoe (https://github.com/utiasSTARS/pyshoe) have their truth in the same file. They are
not part of this project: put ``FG_NAV_DATA`` to where their folder ``vicon`` is.
"""

import os
from pathlib import Path

import fg_nav

trials = sorted(Path(os.environ.get("FG_NAV_DATA", "data"), "vicon").rglob("*.mat"))
if trials:
    result = fg_nav.navigate(trials[0])
    print(f"{trials[0].name}: rmse {result.metrics.rmse_2d_m:.3f} m")
    axes = result.plot()
else:
    print("PyShoe's data are not at hand where this was built.")
