"""Simulated walks with a truth that is exact, and as unforgiving as real ones.

The data's way, one file or package each:

=============================== ======================================================================
`path`, `courses`               ways over the ground; the geometry of the named scenarios
`plan` -> `footsteps.Strides`   from sections of a walk to footprints, times and manners of going
`person`                        how somebody goes, and where a sensor sits on the shoe
`foot`, `thigh` -> `motion`     from strides to the motion of the sensor, in closed form
`fields`                        the Earth's field and what steel does to it
`sensors`                       what a sensor makes of rate, force and field
`scenarios`, `walk`             the named scenarios, and `simulate`, which puts all together
=============================== ======================================================================

>>> walk = simulate("office", seed=1)
>>> walk.recording.truth, walk.biases, walk.landmarks
"""

from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.scenarios import SCENARIOS, Choices, Scenario, scenario
from fg_nav.lab.simulation.walk import BiasTruth, Passing, SimulatedWalk, simulate

__all__ = [
    "SCENARIOS",
    "BiasTruth",
    "Choices",
    "Passing",
    "Person",
    "Scenario",
    "SimulatedWalk",
    "scenario",
    "simulate",
]
