"""Headings at the footfalls of one walk, by compass, gyroscope and filter: what the papers' pictures of headings show.

As in the papers the compass is levelled by the accelerometer of the standing foot, and the gyroscope's heading begins
at the true one.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from fg_nav.frames import compute_heading
from fg_nav.lab.campaign.methods import solve_by
from fg_nav.lab.campaign.walks import LOOP, Simulated
from fg_nav.lab.store.entries import Arrays, Measurement
from fg_nav.magnetic.quasi_static import QUASI_STATIC
from fg_nav.recording import TrajectoryTruth

STRENGTH_HZ = 5.0
"""At which the strength of the field is stored."""


def headings_part(name: str, scenario: str, field: str, seed: int, method: str) -> Measurement:
    """What `headings_of` finds; `name` begins that of the file."""
    words = method.replace(":", "-")
    return Measurement(f"{name}_{scenario}_{field}_{words}_{seed}", partial(headings_of, scenario, field, seed, method))


def headings_of(scenario: str, field: str, seed: int, method: str) -> Arrays:
    """Follow one filter over a walk whose magnetometer is calibrated on the loop.

    Returns
    -------
    dict
        `t` (F,) s, `compass`, `gyroscope`, `estimate` (F,) rad clockwise from north, `used` (F,) where the filter
        used the field, `place` (F, 2) m true, all at the footfalls; `strength_t` (M,) s and `strength` (M,) uT.
    """
    walk = Simulated(scenario, field, seed).prepare(LOOP)
    seen, stances = walk.require_field(), solve_by(method, walk).solution.stances
    recording, truth = walk.recording, walk.truth
    assert recording.mag is not None
    assert isinstance(truth, TrajectoryTruth)
    known = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    every = known[:: max(round(len(known) / (np.ptp(recording.t) * STRENGTH_HZ)), 1)]
    return {
        "t": seen.t,
        "compass": seen.force_heading,
        "gyroscope": seen.gyro_heading,
        "estimate": compute_heading(stances.nav_R_body),
        "used": np.array([word == QUASI_STATIC for word in stances.field]),
        "place": truth.position[seen.sample, :2],
        "strength_t": recording.t[every],
        "strength": np.linalg.norm(recording.mag[every], axis=1),
    }
