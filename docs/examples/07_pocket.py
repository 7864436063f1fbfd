"""
In a trouser pocket
===================

A thigh never stands: orientation comes from gravity and the magnetic field, the way from steps (:doc:`/pocket`). A walk
of a known length shows how long the steps of this person are.
"""

import fg_nav
from fg_nav.lab.simulation import Choices

walk = fg_nav.simulate("demo", seed=1, choices=Choices(worn="pocket")).recording
result = fg_nav.navigate(walk, options=fg_nav.Options(mount="pocket", known_distance_m=87.0), method="pocket")
print(result)
print(*result.notes, sep="\n")
axes = result.plot()
