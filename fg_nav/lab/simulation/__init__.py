"""Simulated walks with a truth that is exact, and as unforgiving as real ones.

Data flow, one file or package each:

=============================== ======================================================================
`path`, `routes`                paths over the ground; the routes of the named scenarios
`plan` -> `motion.Strides`      from sections of a walk to footprints, times and styles
`person`                        gait of a person, and where a sensor sits on the shoe
`foot`, `thigh`                 from strides to the motion of the sensor, in closed form (`motion`)
`fields`                        the Earth's field and what steel does to it
`sensors`                       measurements of rate, force and field, with all their errors
`scenarios`, `walk`             the named scenarios, and `simulate`, which puts all together
`feet`                          strides of the other foot beside the first one, and `simulate_feet`: a sensor on each
=============================== ======================================================================

>>> walk = simulate("office", seed=1)
>>> walk.recording.truth, walk.biases, walk.landmarks
"""

from fg_nav.lab.simulation.feet import SimulatedFeet, simulate_feet
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.scenarios import SCENARIOS, Choices, Scenario, scenario
from fg_nav.lab.simulation.walk import Passing, SimulatedWalk, simulate

__all__ = [
    "SCENARIOS",
    "Choices",
    "Passing",
    "Person",
    "Scenario",
    "SimulatedFeet",
    "SimulatedWalk",
    "scenario",
    "simulate",
    "simulate_feet",
]
