"""
While the walk goes on
======================

Samples go in one by one, as a sensor sends them; a footfall comes out some 0.4 s after the foot has left the ground.
``fg-nav stream`` is the same as a command, with sockets, serial devices and a page: :doc:`/online`.
"""

import numpy as np

import fg_nav
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.navigator import OnlineNavigator

walk = fg_nav.simulate("demo", seed=1).recording.slice(0, 3000)
navigator = OnlineNavigator()
for k in range(len(walk)):
    for found in navigator.push(*(array[k : k + 1] for array in (walk.t, walk.acc, walk.gyr, walk.mag))):
        if isinstance(found, StanceEstimate):
            sigma = np.sqrt(np.diag(found.pose_cov))[:3]
            print(f"{walk.t[k]:5.2f} s: footfall {found.number:2d} at {found.position.round(2)} m +- {sigma.round(2)}")

# %%
# At its end the walk is known as a whole.
axes = navigator.finish().plot()
