"""Estimates as JSON, one object a line.

========================= ======================================================================================
kind                      "now": as known when the footfall was complete; "smoothed": as known at the end
stance                    number of the row, from 0
continues                 of "now": a further piece of a long standing, no new footfall
t                         s, of its stillest sample
sensor_t                  s, the stamp that the sensor gave it, only where that is another: its clock was set on or back
position_m                [east, north, up]
heading_deg               of the body's x axis, clockwise from north, in [0, 360)
position_sigma_m          [east, north, up]
heading_sigma_deg
gyro_bias_deg_s           [x, y, z], body axes
gyro_bias_sigma_deg_s     [x, y, z]
field, field_reason       verdict on the magnetic field, in a word and in words
========================= ======================================================================================

Sigmas are one standard deviation. What is not finite is null.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import heading_of
from fg_nav.online.estimates import StanceEstimate
from fg_nav.plain import plain
from fg_nav.solution import StanceTable

SensorTime = Callable[[int, float], float]
"""The stamp, s, that the sensor gave a sample which was taken with this stamp (`SampleJudge.sensor_time`)."""

DIGITS = 6
"""After the point: a micrometre, a microdegree."""


def _as_taken(sample: int, t: float) -> float:
    return t


def line_of(estimate: StanceEstimate, continues: bool, sensor_time: SensorTime = _as_taken) -> str:
    """Return the line of an estimate of the moment."""
    return _line(
        "now",
        estimate.number,
        {"continues": continues},
        (estimate.t, sensor_time(estimate.sample, estimate.t)),
        estimate.position,
        np.degrees(estimate.heading),
        np.sqrt(np.diagonal(estimate.pose_cov)),
        estimate.gyro_bias,
        estimate.gyro_bias_sigma,
        (estimate.field, estimate.field_reason),
    )


def lines_of(table: StanceTable, sensor_time: SensorTime = _as_taken) -> Iterator[str]:
    """Yield the lines of the smoothed past."""
    heading = np.degrees(heading_of(table.nav_R_body))
    for k in range(len(table)):
        yield _line(
            "smoothed",
            k,
            {},
            (float(table.t[k]), sensor_time(int(table.sample[k]), float(table.t[k]))),
            table.position[k],
            heading[k],
            np.append(table.position_sigma[k], table.heading_sigma[k]),
            table.gyro_bias[k],
            table.gyro_bias_sigma[k],
            (table.field[k], table.field_reason[k]),
        )


def _line(
    kind: str,
    number: int,
    more: dict[str, object],
    stamps: tuple[float, float],
    position: Floats,
    heading_deg: float,
    sigma: Floats,
    bias: Floats,
    bias_sigma: Floats,
    field: tuple[str, str],
) -> str:
    t, sensor_t = (round(stamp, 9) for stamp in stamps)
    content = {
        "kind": kind,
        "stance": number,
        **more,
        "t": t,
        **({} if sensor_t == t else {"sensor_t": sensor_t}),
        "position_m": np.round(position, DIGITS),
        "heading_deg": round(float(heading_deg % 360.0), DIGITS),
        "position_sigma_m": np.round(sigma[:3], DIGITS),
        "heading_sigma_deg": round(float(np.degrees(sigma[3])), DIGITS),
        "gyro_bias_deg_s": np.round(np.degrees(bias), DIGITS),
        "gyro_bias_sigma_deg_s": np.round(np.degrees(bias_sigma), DIGITS),
        "field": field[0],
        "field_reason": field[1],
    }
    return json.dumps(plain(content), allow_nan=False)
