"""What is told of a footfall of a walk in progress, and how it is kept: a row of numbers, for a walk has thousands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.solution import StanceTable


@dataclass(frozen=True)
class StanceEstimate:
    """Where the foot stands, as known when its footfall was complete; at the stillest sample of the footfall.

    ================ ======= =======================================================================
    number                   of the footfall, from 0
    sample                   counted from the first of the walk
    t                        s
    position         (3,)    m, navigation frame
    nav_R_body       (3, 3)
    heading                  rad, of the body's x axis, clockwise from north
    velocity         (3,)    m/s
    gyro_bias        (3,)    rad/s
    pose_cov         (4, 4)  of east, north, up (m) and yaw about up (rad)
    gyro_bias_sigma  (3,)    rad/s
    field                    verdict on the field, as in a stance table
    field_reason             in words
    ================ ======= =======================================================================
    """

    number: int
    sample: int
    t: float
    position: Floats
    nav_R_body: Floats
    heading: float
    velocity: Floats
    gyro_bias: Floats
    pose_cov: Floats
    gyro_bias_sigma: Floats
    field: str
    field_reason: str


class Packed(NamedTuple):
    """An estimate as one row of numbers (37,) and its words."""

    numbers: Floats
    field: str
    field_reason: str


def packed(one: StanceEstimate) -> Packed:
    """Pack an estimate."""
    matrices = (one.position, one.nav_R_body, one.gyro_bias, one.pose_cov, one.gyro_bias_sigma)
    numbers = np.concatenate([[one.sample, one.t], *(matrix.ravel() for matrix in matrices)])
    return Packed(numbers, one.field, one.field_reason)


def table_of(rows: Sequence[Packed]) -> StanceTable:
    """Return the table of some packed estimates."""
    numbers = np.array([row.numbers for row in rows]).reshape(len(rows), -1)
    sample, t, position, attitude, bias, pose_cov, bias_sigma = np.split(numbers, (1, 2, 5, 14, 17, 33), axis=1)
    pose_cov = pose_cov.reshape(-1, 4, 4)
    return StanceTable(
        sample=sample[:, 0].astype(np.int64),
        t=t[:, 0],
        position=position,
        nav_R_body=attitude.reshape(-1, 3, 3),
        gyro_bias=bias,
        position_cov=pose_cov[:, :3, :3],
        heading_sigma=np.sqrt(pose_cov[:, 3, 3]),
        gyro_bias_sigma=bias_sigma,
        field=tuple(row.field for row in rows),
        field_reason=tuple(row.field_reason for row in rows),
        pose_cov=pose_cov,
    )
