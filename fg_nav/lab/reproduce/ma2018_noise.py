"""Two hours of noise, for the sigmas of Ma's detector (2018, section 5.2; M-E2).

y is what the detector looks at, from one instant to the next: the change of magnetic minus gyro heading, of the
inclination and of the strength (Eq. 13). The paper says neither whether the foot stood or walked, nor from which
instant to which: "rad/s" for a heading in steps of a stride, and no time at all for the strength. Three readings:

========== =========================================================================================================
walked     from footfall to footfall, in a field without steel; magnetometer calibrated on the loop, as Ma's
iron on    the same with the magnetometer as it is in the shoe, its iron turning with the foot
at rest    from sample to sample of the magnetometer, the shoe on a table
========== =========================================================================================================
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap
from fg_nav.lab.campaign.sources import LOOP, RAW, Simulated
from fg_nav.lab.reproduce.parts import Arrays, Part
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.magnetic import FootfallField, footfall_field
from fg_nav.magnetic.compass import heading_of_field, inclination_of, levelled_field

SENSOR = "mpu-9250x8"

WALK = "office"
"""12.2 minutes: ten of them are two hours."""

WALKED, IRON_ON, AT_REST = "walked", "iron on", "at rest"

REST_S, QUICK_REST_S = 7200.0, 600.0


def noise_part(seed: int, rest_s: float) -> Part:
    """Sigmas of one seed: (heading rad, inclination rad, strength uT), by the names above."""
    return Part(f"ma2018_noise_{seed}_{rest_s:.0f}s", partial(noise, seed, rest_s))


def noise(seed: int, rest_s: float) -> Arrays:
    """Measure one seed; no rest where `rest_s` is zero."""
    found = {}
    walk = Simulated(WALK, "homogeneous", seed)
    for name, magnetometer in ((WALKED, LOOP), (IRON_ON, RAW)):
        try:
            recording = walk.session(magnetometer).recording
        except CalibrationError:
            found[name] = np.full(3, np.inf)
            continue
        found[name] = _sigmas(*_seen(footfall_field(recording, detect_stances(recording))))
    if rest_s:
        found[AT_REST] = _sigmas(*_lying(seed, rest_s))
    return found


def _seen(field: FootfallField) -> tuple[Floats, Floats, Floats]:
    """What the detector sees of the footfalls that have a field."""
    known = np.isfinite(field.strength)
    return field.heading_difference[known], field.inclination[known], field.strength[known]


def _lying(seed: int, rest_s: float) -> tuple[Floats, Floats, Floats]:
    """The same sample by sample; the rate of a shoe at rest is no more than its bias, which the walk would take off."""
    still = replace(SCENARIOS["at-rest"], course=lambda rng: [Stand(rest_s)])
    recording = simulate(still, seed, Choices(sensor=SENSOR, rate_hz=100.0)).recording
    assert recording.mag is not None
    mag = recording.mag[np.isfinite(recording.mag).all(axis=1)]
    up = np.nanmean(recording.acc, axis=0)
    level = levelled_field(mag, np.broadcast_to(up, mag.shape))
    return heading_of_field(level), inclination_of(level), np.linalg.norm(mag, axis=1)


def _sigmas(heading: Floats, inclination: Floats, strength: Floats) -> Floats:
    """Standard deviations of the changes."""
    return np.array([np.std(wrap(np.diff(heading))), np.std(np.diff(inclination)), np.std(np.diff(strength))])
