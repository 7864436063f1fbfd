"""Footfalls in a field that is given, made by hand."""

import numpy as np

from fg_nav.frames import level_attitude
from fg_nav.magnetic import FootfallField

DIP = np.deg2rad(64.0)
EARTH = 48.0 * np.array([0.0, np.cos(DIP), -np.sin(DIP)])  # uT, in nav: Munich.


def footfalls(nav_field, heading=0.0, drift=0.0, noise_uT=0.0, rate=0.0, rng=None, stride_s=1.1, mount=None):
    """Footfalls in the field (F, 3) uT, with these headings and this drift (F,) rad of the gyroscope's heading.

    `rate` (F,) uT/s is the strength rate within the stance; `mount` (3, 3) turns the sensor where it sits.
    """
    nav_field = np.atleast_2d(nav_field)
    n = len(nav_field)
    mount = np.eye(3) if mount is None else mount
    heading, drift = np.broadcast_to(heading, n), np.broadcast_to(drift, n)
    true = np.stack([level_attitude(np.array([0.0, 0.0, 1.0]), h) for h in heading]) @ mount
    claimed = np.stack([level_attitude(np.array([0.0, 0.0, 1.0]), h) for h in heading + drift]) @ mount
    body = np.einsum("nji,nj->ni", true, nav_field)
    if rng is not None:
        body = body + noise_uT * rng.standard_normal((n, 3))
    return FootfallField(
        sample=np.arange(n) * 110,
        t=np.arange(n) * stride_s,
        body_field=body,
        body_force=9.81 * true[:, 2],
        nav_R_body=claimed,
        count=np.full(n, 25),
        scatter_uT=np.full(n, 0.3),
        strength_rate=np.broadcast_to(rate, n).astype(float),
        strength_rate_sigma=np.full(n, 0.3),
        iron_sigma_uT=np.full((n, 3), 0.3),
    )


def still(n):
    """The Earth's field at n footfalls."""
    return np.tile(EARTH, (n, 1))


def turned(angles):
    """The Earth's field, turned clockwise over the ground by these angles (F,) rad."""
    horizontal, zero = EARTH[1], np.zeros(len(angles))
    return np.stack([horizontal * np.sin(angles), horizontal * np.cos(angles), zero + EARTH[2]], axis=1)
