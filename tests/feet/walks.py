"""A simulated walk with a sensor on each foot, a minute round a block, and both feet of it in one graph."""

from dataclasses import replace
from functools import cache

from fg_nav.detection import detect_stances
from fg_nav.feet import SIDES, Side
from fg_nav.feet.person import FeetSolution
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation import SimulatedFeet, simulate_feet
from fg_nav.recording import Recording
from fg_nav.smoother.batch import WalkInput
from fg_nav.smoother.feet import smooth_feet
from fg_nav.truth import TrajectoryTruth


@cache
def demo_feet(seed: int = 5) -> SimulatedFeet:
    return simulate_feet("demo", seed)


def truth_of(side: Side) -> TrajectoryTruth:
    return demo_feet().sides[side].recording.truth


@cache
def without_field() -> dict[Side, Recording]:
    return {side: replace(one.recording, mag=None) for side, one in demo_feet().sides.items()}


@cache
def feet() -> dict[Side, WalkInput]:
    """Both without a field, and with their true headings at the start."""
    headings = {side: float(compute_heading(truth_of(side).nav_R_body[0])) for side in SIDES}
    return {side: WalkInput(one, detect_stances(one), headings[side]) for side, one in without_field().items()}


@cache
def both() -> FeetSolution:
    return smooth_feet(feet()["right"], feet()["left"])
