"""fg-nav: pedestrian inertial navigation as a factor graph.

Frames, units and the order of steps, the same in every module.

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

The data's way is one page, `fg_nav.pipeline`: `fg_nav.io` -> `Recording` -> `fg_nav.calibration` ->
`fg_nav.detection` -> `Stances` -> `fg_nav.magnetic` -> `FootfallField` -> `fg_nav.smoother` (of `fg_nav.factors`),
`fg_nav.ekf` or `fg_nav.online` -> `Solution` -> `fg_nav.evaluation` -> `Outcome` -> `fg_nav.report`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult as FeetResult
    from fg_nav.both_feet import navigate_feet as navigate_feet
    from fg_nav.detection import detect_stances as detect_stances
    from fg_nav.detection.stance import Stances as Stances
    from fg_nav.ekf import run_iez as run_iez
    from fg_nav.errors import FgNavError as FgNavError
    from fg_nav.evaluation import evaluate as evaluate
    from fg_nav.io import read as read
    from fg_nav.io import read_truth as read_truth
    from fg_nav.lab.simulation import simulate as simulate
    from fg_nav.magnetic.footfall_field import average_footfall_field as average_footfall_field
    from fg_nav.pipeline import Result as Result
    from fg_nav.pipeline import navigate as navigate
    from fg_nav.recording import Recording as Recording
    from fg_nav.smoother import GraphNodes as GraphNodes
    from fg_nav.smoother import SmoothedWalk as SmoothedWalk
    from fg_nav.smoother import SmootherParameters as SmootherParameters
    from fg_nav.smoother import smooth as smooth
    from fg_nav.smoother import smooth_graph as smooth_graph
    from fg_nav.solution import Solution as Solution
    from fg_nav.truth import Fix as Fix
    from fg_nav.truth import FootprintTruth as FootprintTruth
    from fg_nav.truth import TrajectoryTruth as TrajectoryTruth
    from fg_nav.walk import Options as Options

_PUBLIC = {
    "fg_nav.both_feet": ("FeetResult", "navigate_feet"),
    "fg_nav.detection": ("detect_stances",),
    "fg_nav.detection.stance": ("Stances",),
    "fg_nav.ekf": ("run_iez",),
    "fg_nav.errors": ("FgNavError",),
    "fg_nav.evaluation": ("evaluate",),
    "fg_nav.io": ("read", "read_truth"),
    "fg_nav.lab.simulation": ("simulate",),
    "fg_nav.magnetic.footfall_field": ("average_footfall_field",),
    "fg_nav.pipeline": ("Result", "navigate"),
    "fg_nav.recording": ("Recording",),
    "fg_nav.smoother": ("GraphNodes", "SmoothedWalk", "SmootherParameters", "smooth", "smooth_graph"),
    "fg_nav.solution": ("Solution",),
    "fg_nav.truth": ("Fix", "FootprintTruth", "TrajectoryTruth"),
    "fg_nav.walk": ("Options",),
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names}

# What a solution asks of modules above it, for its plots, files, tables and notebooks.
_UPWARD = {
    "plot_solution": "fg_nav.report.files",
    "save_solution": "fg_nav.report.files",
    "render_solution": "fg_nav.report.notebook",
    "tabulate_gait": "fg_nav.gait",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: the graph library and the compiler take a second to load."""
    home = _HOME.get(name) or _UPWARD.get(name)
    if home is None:
        raise AttributeError(f"module 'fg_nav' has no attribute '{name}'")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    """List the public names, so that an interpreter offers them."""
    return __all__
