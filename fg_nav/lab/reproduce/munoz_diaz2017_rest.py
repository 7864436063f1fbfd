"""Gyroscopes of Munoz Diaz et al. (2017) as simulated: at rest (Section 2.2, Figure 5), on the walks (Tables 2, 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.calibration.allan import AllanCurve, allan_curve
from fg_nav.lab.simulation import SCENARIOS, Choices, SimulatedWalk, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.sensors import ClockPrior, preset
from fg_nav.pocket import PRESETS, estimate_pocket, level_start
from fg_nav.pocket.belief import earth_rate
from fg_nav.pocket.paper import FIELDS_UT
from fg_nav.recording import TrajectoryTruth

LATITUDE_DEG = 48.0


@dataclass(frozen=True)
class AllanPair:
    """Allan deviations of the fibre-optic and of the MEMS gyroscopes, deg/s, an axis each."""

    fog: Sequence[AllanCurve]
    mems: Sequence[AllanCurve]


def fog_errors(seed: int, hours: float) -> dict[str, float]:
    """Section 2.2: the fibre-optic gyroscope at rest, integrated for an hour; the Earth's rate added and taken off."""
    scenario = replace(SCENARIOS["at-rest"], course=lambda rng: [Stand(3600.0 * hours)])
    recording = simulate(scenario, seed, Choices(sensor="kvh-1750", rate_hz=10.0)).recording
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    turning = np.einsum("nji,j->ni", truth.nav_R_body, earth_rate(LATITUDE_DEG))
    seen = replace(recording, gyr=recording.gyr + turning)
    found = {}
    for name, latitude in (("compensated", LATITUDE_DEG), ("not compensated", None)):
        parameters = replace(PRESETS["munoz-diaz2017"], gravity_update=False, latitude_deg=latitude)
        start = replace(level_start(seen, parameters), nav_R_body=truth.nav_R_body[0])
        R = estimate_pocket(seen, parameters, start).nav_R_body
        turned = Rotation.from_matrix(R @ truth.nav_R_body.transpose(0, 2, 1)).as_rotvec(degrees=True)
        found[name] = float(np.abs(turned).max())
    return found


def allan_pair(seed: int, hours: float) -> AllanPair:
    """Allan deviations of both gyroscopes at rest, deg/s (Figure 5)."""
    scenario = replace(SCENARIOS["at-rest"], course=lambda rng: [Stand(3600.0 * hours)])
    curves = {}
    for sensor in ("kvh-1750", "xsens-mtw"):
        prior = replace(preset(sensor), rate_hz=10.0, clock=ClockPrior())  # no sample lost
        recording = simulate(replace(scenario, sensor=prior), seed).recording
        curves[sensor] = [allan_curve(np.degrees(axis), recording.period_s) for axis in recording.gyr.T]
    return AllanPair(curves["kvh-1750"], curves["xsens-mtw"])


def sensor_errors(first: SimulatedWalk, second: SimulatedWalk) -> dict[str, Floats]:
    """Tables 2 and 3 as measured on the recordings, deg/s: against the truth, and standing at both ends."""
    truth, h = first.recording.truth, first.recording.period_s
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    R = Rotation.from_matrix(truth.nav_R_body)
    wrong = np.degrees(first.recording.gyr[:-1] - (R[:-1].inv() * R[1:]).as_rotvec() / h)
    start, end = (np.degrees(part.mean(axis=0)) for part in (second.recording.gyr[:900], second.recording.gyr[-900:]))
    across = field_across(truth.nav_R_body)
    return {"noise": wrong.std(axis=0), "bias": wrong.mean(axis=0), "start": start, "end": end, "across": across}


def field_across(nav_R_body: Floats) -> Floats:
    """Rms field (S,) uT across the thigh at each of the sites: what shows the bias along it."""
    along = nav_R_body[:, :, 2]
    return np.array([math.sqrt(np.mean(np.dot(field, field) - (along @ field) ** 2)) for field in FIELDS_UT.values()])
