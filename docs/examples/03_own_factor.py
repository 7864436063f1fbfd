"""
A factor of your own
====================

The person says that the walk ended where it began, to 10 cm. ``extra`` is given the variables of the walk and returns a
graph of GTSAM, which joins the walk's before it is solved; the sigmas reflect it (:doc:`/python`).
"""

import gtsam

import fg_nav

recording = fg_nav.simulate("demo", seed=1).recording


def end_at_start(nodes):
    """Tie the last node to the origin."""
    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.GPSFactor(nodes.pose[-1], [0, 0, 0], gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
    return graph


without = fg_nav.navigate(recording, "inertial")
tied = fg_nav.navigate(recording, "inertial", extra=end_at_start)
for name, result in (("without", without), ("tied", tied)):
    print(f"{name:8s} sigma at the end (m):", result.stances.position_sigma[-1].round(3))

# %%
# The ellipses are widest in the middle of the walk now.
axes = tied.plot()
