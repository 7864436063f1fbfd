"""fg-nav: pedestrian inertial navigation as a factor graph.

This page is the constitution: every module keeps to it.

Frames
------
nav
    Navigation frame, East-North-Up: x east, y north, z up, gravity (0, 0, -g). Without a magnetometer and
    without a given heading, "north" is the direction of the body's x axis at the start.
body
    The sensor's axes: forward-left-up or any other right-handed set, as mounted.

A frame stands in the name of what is expressed in it: `nav_R_body` maps body vectors to navigation vectors,
`body_field` is a field seen in the body frame. Positions and velocities without a frame in the name are in nav.

Units
-----
SI inside: s, m, m/s, m/s^2, rad, rad/s; magnetic flux density in uT. `acc` is specific force: +g on the up axis
of a sensor at rest. Heading for people is in degrees clockwise from north. Where a reader could be unsure, the unit
stands in the name (`_deg_s`, `_uT`, `_m_s2`).

Types
-----
Recording
    What the sensor recorded (`fg_nav.recording`).
Stances
    When the foot stands: found once, shared by all estimators (`fg_nav.stances`).
FootfallField
    The field at each footfall: found once, shared too (`fg_nav.magnetic`).
FieldVerdicts
    Where a detector finds the field undisturbed. Those of a walk are for the report; an estimator that uses the field
    judges it itself (`fg_nav.magnetic.quasi_static`).
Walk
    All of these, and what the user chose: the input of every estimator (`fg_nav.walk`).
Solution
    What every estimator returns: the dense trajectory and one row a stance (`fg_nav.solution`).
Outcome
    A solution and its errors (`fg_nav.walk`).

The data's way is one page, `fg_nav.pipeline`: `fg_nav.io` -> `Recording` -> `fg_nav.calibration` ->
`fg_nav.detection` -> `Stances` -> `fg_nav.magnetic` -> `FootfallField` -> `fg_nav.smoother` (of `fg_nav.factors`),
`fg_nav.ekf` or `fg_nav.online` -> `Solution` -> `fg_nav.evaluation` -> `Outcome` -> `fg_nav.report`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fg_nav.detection import detect_stances
    from fg_nav.ekf import run_iez
    from fg_nav.errors import FgNavError
    from fg_nav.evaluation import evaluate
    from fg_nav.io import read
    from fg_nav.magnetic.footfall_field import average_footfall_field
    from fg_nav.pipeline import prepare_walk, run_method
    from fg_nav.recording import Recording
    from fg_nav.smoother import smooth
    from fg_nav.solution import Solution
    from fg_nav.stances import Stances
    from fg_nav.walk import Options, Outcome, Walk, read_walk

_HOME = {
    "FgNavError": "fg_nav.errors",
    "Options": "fg_nav.walk",
    "Outcome": "fg_nav.walk",
    "Recording": "fg_nav.recording",
    "Solution": "fg_nav.solution",
    "Stances": "fg_nav.stances",
    "Walk": "fg_nav.walk",
    "detect_stances": "fg_nav.detection",
    "evaluate": "fg_nav.evaluation",
    "average_footfall_field": "fg_nav.magnetic.footfall_field",
    "prepare_walk": "fg_nav.pipeline",
    "read": "fg_nav.io",
    "read_walk": "fg_nav.walk",
    "run_iez": "fg_nav.ekf",
    "run_method": "fg_nav.pipeline",
    "smooth": "fg_nav.smoother",
}

__all__ = [
    "FgNavError",
    "Options",
    "Outcome",
    "Recording",
    "Solution",
    "Stances",
    "Walk",
    "average_footfall_field",
    "detect_stances",
    "evaluate",
    "prepare_walk",
    "read",
    "read_walk",
    "run_iez",
    "run_method",
    "smooth",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: the graph library and the compiler take a second to load."""
    if name not in _HOME:
        raise AttributeError(f"module 'fg_nav' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """List the public names, so that an interpreter offers them."""
    return sorted(__all__)
