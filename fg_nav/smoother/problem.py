"""The recipe from a walk to the problem that is solved, the same for the batch, online and the noise evidence.

start -> rests; rests -> gyro bias and its sigma; stances -> lever of the rolling foot; evidence -> noise of a swing;
all of it -> nodes, factors and initial values (`graph`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration import RollingLever, estimate_lever
from fg_nav.detection import Rest
from fg_nav.ends import find_start
from fg_nav.recording import Recording
from fg_nav.smoother.graph import Known, WalkProblem, build_problem
from fg_nav.smoother.noise_level import SwingNoise, choose_swing_noise
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.stances import Stances
from fg_nav.text import format_count


def walk_problem(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
    in_progress: bool = False,
) -> WalkProblem:
    """Make the problem of a walk from what its recording shows.

    Parameters
    ----------
    heading : float or None
        Of the body's x axis at the start, rad clockwise from north; None where it is not known: then zero.
    in_progress : bool
        Whether the walk goes on after the recording: then what is a rest only because the recording ends is none.
    """
    start = find_start(recording, stances, heading or 0.0, p.rest)
    rests = _whole_rests(start.rests, recording, p) if in_progress else start.rests
    known, swing = _estimate_known(recording, stances, rests, p)
    p = replace(p, gyr_relative_density=swing.gyr_relative_density)
    return build_problem(recording, stances, start.nav_R_body, known, p, heading is not None, progress)


def estimate_swing_noise(recording: Recording, stances: Stances, p: SmootherParameters) -> float:
    """Return the noise of the rate in a swing, 1/sqrt(Hz), that the smoother uses on this walk."""
    rests = find_start(recording, stances, parameters=p.rest).rests
    return _estimate_known(recording, stances, rests, p)[1].gyr_relative_density


def _estimate_known(
    recording: Recording, stances: Stances, rests: tuple[Rest, ...], p: SmootherParameters
) -> tuple[Known, SwingNoise]:
    bias, sigma = _bias_from_rests(rests, np.radians(p.gyro_bias_sigma_deg_s))
    if p.known_lever is not None:
        lever = RollingLever(np.array(p.known_lever), np.zeros((3, 3)), 0)
    else:
        lever = estimate_lever(recording, stances)
    known = Known(bias, sigma, rests, lever)
    swing = SwingNoise(p.gyr_relative_density, "swing noise as given")
    if p.choose_swing_noise:
        swing = choose_swing_noise(recording, stances, known, p)
    return replace(known, notes=(_bias_note(known), _lever_note(lever), swing.note)), swing


def _whole_rests(rests: tuple[Rest, ...], recording: Recording, p: SmootherParameters) -> tuple[Rest, ...]:
    """Leave out what is a rest only if the recording ends there."""
    first = recording.t[0] + 1.0
    return tuple(
        rest for rest in rests if rest.lasts(recording.period_s, p.rest.shortest_s) or recording.t[rest.start] < first
    )


def _bias_from_rests(rests: tuple[Rest, ...], prior_sigma: float) -> tuple[Floats, float]:
    """Bias (3,) to start from and the sigma of its prior about zero, rad/s.

    Rests that show a bias far outside the prior show a sensor that was not calibrated: the prior widens to it.
    """
    if not rests:
        return np.zeros(3), prior_sigma
    weight = np.array([rest.sigma**-2 for rest in rests])
    mean = weight @ np.array([rest.rate for rest in rests]) / weight.sum()
    sigma = float(np.hypot(prior_sigma, np.linalg.norm(mean)))
    return mean * sigma**2 / (sigma**2 + 1 / weight.sum()), sigma


def _bias_note(known: Known) -> str:
    if not known.rests:
        return "gyro bias from the walk alone, there is no rest in it"
    bias = np.round(np.degrees(known.gyro_bias), 3).tolist()
    return f"gyro bias {bias} deg/s from {format_count(len(known.rests), 'rest')}"


def _lever_note(lever: RollingLever) -> str:
    if not lever.lever.any():
        return "sensor taken to stand where the foot rolls: plain zero velocity"
    x, y, z = lever.lever * 1000
    return f"sensor at ({x:.0f}, {y:.0f}, {z:.0f}) mm from the point about which the foot rolls, body axes"
