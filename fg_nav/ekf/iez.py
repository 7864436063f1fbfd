"""IEZ: strapdown navigation, updated while the foot stands (INS + EKF + ZUPT): the core and nothing else.

References: Foxlin (2005), "Pedestrian tracking with shoe-mounted inertial sensors"; Jimenez et al. (2010),
"Indoor pedestrian navigation using an INS/EKF framework for yaw drift reduction and a foot-mounted IMU".
"""

from __future__ import annotations

from dataclasses import asdict
from time import perf_counter

from fg_nav.detection.rest import find_start
from fg_nav.ekf.core import compile_filter, describe_start, filter_walk, make_solution
from fg_nav.ekf.parameters import IezParameters
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

UNUSED = "the filter does not use the magnetometer"


def run_iez(
    recording: Recording,
    stances: Stances,
    parameters: IezParameters = IezParameters(),
    heading: float = 0.0,
) -> Solution:
    """Navigate a walk forward in time.

    Parameters
    ----------
    recording : Recording
        The magnetometer is not used.
    stances : Stances
        When the foot stood, on this recording.
    parameters : IezParameters
    heading : float
        Of the body's x axis at the start, rad clockwise from north.

    Raises
    ------
    EstimationError
        Without a stance, with stances of another recording, without gravity in the specific force, or where
        the filter diverges to infinity.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> fg_nav.run_iez(recording, fg_nav.detect_stances(recording)).method
    'iez'
    """
    compile_filter()
    began = perf_counter()
    start = find_start(recording, stances, heading, parameters.rest)
    rows = stances.stillest(recording.gyr)
    track = filter_walk(recording, stances.mask, rows, start, parameters)
    note, unused = describe_start(recording, start, parameters), (("none",) * len(rows), (UNUSED,) * len(rows))
    return make_solution(recording, stances, track, unused, asdict(parameters), "iez", began, note)
