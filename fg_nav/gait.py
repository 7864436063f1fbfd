"""Gait parameters of each stride of a foot, and of each step of two feet, from their solutions alone.

A stride goes from a footfall k to the next of the same foot, like gaitmap's `min_vel` strides: p_k (m) and R_k are
position and nav_R_body of the sensor at the footfall's stillest sample, d the horizontal move between, u = d / |d|, n
the unit vector to its left. Parameters are those of Rampp et al. (2015) and gaitmap (Kuederle et al. 2024):

    length      |d|,          rise   z_(k+1) - z_k
    turning     yaw of R_(k+1) R_k^T, clockwise from above
    clearance   greatest height of the sensor over the line from p_k to p_(k+1)
    pitch       asin(up . R(t) R_j^T f_j), toe up, against that at footfall j, f_j being the foot's forward direction
                there, level: what of the sensor points along d in the mean over the walk, so that nothing depends on
                how it is mounted
    toe off     fastest toe-down rotation (j = k) before the largest toe-down pitch of the stride
    contact     heel strike: largest toe-up pitch (j = k + 1) between toe off and footfall k + 1
    duration    contact before footfall k to contact before footfall k + 1; where one is unknown footfall to footfall
    cadence     120 / duration, steps of both feet in a minute,          speed  length / duration
    stance      1 - (contact - toe off) / duration, share of the duration by contacts

Two feet. Between footfalls k and k+1 stands the other foot, at q:

    step length     u . (p_(k+1) - q),          step width  n . (q - p_k) at a right foot, its negative at a left one
    step time       contact of the other foot before q to the contact of this stride.

Sigmas are those of the joint covariance of both footfalls (`StanceTable.move_cov`): of d along u, and of the yaw. Speed
has that of the length alone. Where an estimator has no joint covariance they are NaN.

What crosses a hole of the recording, or takes longer than a stride of a walk (`feet.steps.find_longest_stride`), is no
stride. `steady` are strides with one before and one after, and no turns: neither of setting off nor of stopping.

Sources: A. Rampp et al., "Inertial sensor-based stride parameter calculation from gait sequences in geriatric
patients", IEEE TBME 62(4), 2015; A. Kuederle et al., "Gaitmap - an open ecosystem for IMU-based human gait analysis and
algorithm benchmarking", IEEE OJEMB 5, 2024; events as of gaitmap 2.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.evaluation.comparison import yaw_between
from fg_nav.feet.steps import Footfalls, find_longest_stride, find_steps
from fg_nav.samples.gaps import cross_holes, find_holes
from fg_nav.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

PARAMETERS = (
    "length_m", "duration_s", "speed_m_s", "cadence_steps_min", "stance_share", "clearance_m", "rise_m", "turning_deg",
    "step_length_m", "step_width_m", "step_time_s",
)  # fmt: skip
"""Columns with means; the last three of two feet."""
GAIT_COLUMNS = (
    "foot", "index", "start_s", "end_s", "toe_off_s", "contact_s", "steady", *PARAMETERS,
    "sigma_length_m", "sigma_speed_m_s", "sigma_turning_deg",
)  # fmt: skip
COMPARED = ("length_m", "stance_share", "step_time_s")  # Of both feet: neither a mounting nor their ties decide these.
MIN_LENGTH_M = 0.2  # Of a stride with a direction: a foot that is set aside, or turned, has none.
MAX_TURN_DEG = 60.0  # Of a steady stride: more is a turn on the spot, or round a corner.
MIN_TOE_UP_RAD = np.deg2rad(3.0)  # At a contact with the heel: what is less is the roll of a foot that stands.
MIN_STRIDES = 3  # Steady ones, for a mean.

Strides: TypeAlias = dict[str, Floats]
"""Columns (K-1,) of a foot with K footfalls, a row each move from one to the next."""


def tabulate_gait(feet: Mapping[Any, Solution], beside: bool = False) -> pd.DataFrame:
    """Return the strides of each foot as rows of `GAIT_COLUMNS`, NaN where unknown.

    `feet` are by the word for the column `foot`; `beside` if they are `left` and `right` in one frame, on one clock.

    Raises `EstimationError` for a sensor in a pocket.
    """
    import pandas as pd

    tables = {foot: measure_strides(solution) for foot, solution in feet.items()}
    if beside:
        for foot, other, side in (("left", "right", -1.0), ("right", "left", 1.0)):
            measure_steps(side, tables[foot], feet[foot], tables[other], feet[other])
    frames = []
    for foot, table in tables.items():
        frame = pd.DataFrame({"foot": foot, **table}).reindex(columns=list(GAIT_COLUMNS))
        frames.append(frame[table["kept"] > 0.0].astype({"index": np.int64, "steady": np.bool_}))
    return pd.concat(frames, ignore_index=True)


def measure_strides(solution: Solution) -> Strides:
    """Return all moves of a foot between footfalls; `kept` are the strides among them."""
    table, t = solution.stances, solution.t
    walk = getattr(solution, "walk", None)  # of a `Result`
    if walk is not None and walk.options.mount == "pocket":
        raise EstimationError("strides are measured by a sensor on a foot: take the rows 'samples' or 'footfalls'.")
    sample, count = np.searchsorted(t, table.t), max(len(table) - 1, 0)
    move, took, body_R_nav = np.diff(table.position, axis=0), np.diff(table.t), table.nav_R_body.transpose(0, 2, 1)
    length, unseen = np.hypot(move[:, 0], move[:, 1]), cross_holes(t, sample)
    # the foot's forward direction, level at each footfall: the mean direction of the moves before and behind footfalls
    level = move * [1.0, 1.0, 0.0]
    forward = table.nav_R_body @ np.einsum("kij,kj->i", body_R_nav[:-1] + body_R_nav[1:], level)
    forward[:, 2] = 0.0
    forward /= np.maximum(np.linalg.norm(forward, axis=1, keepdims=True), MIN_LENGTH_M)  # a foot that stays has none
    body_forward = np.einsum("kij,kj->ki", body_R_nav, forward)
    # height over the line between the footfalls, and events
    clearance, toe_off, contact = np.full((3, count), np.nan)
    for k in np.flatnonzero(~unseen):
        part = slice(sample[k], sample[k + 1] + 1)
        way = solution.position[part] - table.position[k]
        share = np.clip(way[:, :2] @ move[k, :2] / max(length[k], MIN_LENGTH_M) ** 2, 0.0, 1.0)
        clearance[k] = np.max(way[:, 2] - share * move[k, 2])
        up = np.clip(solution.nav_R_body[part, 2] @ body_forward[k : k + 2].T, -1.0, 1.0)
        toe_off[k], contact[k] = find_events(t[part], *np.arcsin(up).T)
    # durations by contacts, else by footfalls
    before = np.append(np.nan, contact[:-1])
    by_contacts, limit = contact - before, find_longest_stride(table.t)
    duration = np.where(np.isfinite(by_contacts), by_contacts, took)
    kept = ~unseen & (took <= limit) & (duration <= limit)
    # turns, and steady strides
    turning_deg = np.rad2deg(yaw_between(table.nav_R_body[1:], table.nav_R_body[:-1]))  # back: clockwise
    around = np.concatenate([[False], kept, [False]])
    goes_on = around[:-2] & kept & around[2:] & np.isfinite(by_contacts) & (np.abs(turning_deg) < MAX_TURN_DEG)
    # sigmas of moves
    cov = np.full((count, 4, 4), np.nan) if table.move_cov is None else table.move_cov[1:]
    along = np.einsum("ki,kij,kj->k", level, cov[:, :3, :3], level)
    sigma = np.sqrt(np.divide(along, length**2, out=np.full(count, np.nan), where=length > MIN_LENGTH_M))
    return {
        "index": np.arange(count, dtype=np.float64),
        "start_s": table.t[:-1],
        "end_s": table.t[1:],
        "toe_off_s": toe_off,
        "contact_s": contact,
        "steady": 1.0 * goes_on,
        "length_m": length,
        "duration_s": duration,
        "speed_m_s": length / duration,
        "cadence_steps_min": 120.0 / duration,
        "stance_share": 1.0 - (contact - toe_off) / by_contacts,
        "clearance_m": clearance,
        "rise_m": move[:, 2],
        "turning_deg": turning_deg,
        "sigma_length_m": sigma,
        "sigma_speed_m_s": sigma / duration,
        "sigma_turning_deg": np.rad2deg(np.sqrt(cov[:, 3, 3])),
        "kept": 1.0 * kept,
    }


def find_events(t: Floats, from_start: Floats, to_end: Floats) -> tuple[float, float]:
    """Return toe off and heel contact, s, of a stride by its pitch (N,) against both footfalls, rad; NaN for none."""
    lowest = int(np.argmin(from_start))
    highest = lowest + int(np.argmax(to_end[lowest:]))
    if lowest == 0 or to_end[highest] < MIN_TOE_UP_RAD or highest == len(t) - 1:
        return np.nan, np.nan
    fastest = int(np.argmin(np.gradient(from_start[: lowest + 1], t[: lowest + 1])))
    return float(t[fastest]), float(t[highest])


def measure_steps(side: float, strides: Strides, foot: Solution, of_other: Strides, other: Solution) -> None:
    """Add the steps of a foot to its strides, past the other one; `side` is 1 for the right foot, -1 for the left."""
    footfalls, others = (
        Footfalls(one.stances.t, one.stances.position, one.t[find_holes(one.t)]) for one in (foot, other)
    )
    found, count = find_steps(others, footfalls), len(footfalls) - 1
    k, n = found.before, found.left_normal
    step = (footfalls.position[k + 1] - others.position[found.at])[:, :2]
    contact = np.append(np.nan, of_other["contact_s"])[found.at]
    for name, values in (
        ("step_length_m", step[:, 0] * n[:, 1] - step[:, 1] * n[:, 0]),
        ("step_width_m", -side * (step * n).sum(axis=1)),
        ("step_time_s", strides["contact_s"][k] - contact),
    ):
        strides[name] = np.full(count, np.nan)
        strides[name][k] = values


def summarize_gait(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return the number of steady strides of each foot, and where they are not few `mean` and `sd` of their parameters.

    A table without strides is that of one foot. Of two feet with means `asymmetry_percent` besides: of the means, right
    less left, over the mean of both.
    """
    feet: dict[str, dict[str, Any]] = {}
    for foot in dict.fromkeys(table["foot"]) or [""]:
        rows = table[(table["foot"] == foot) & table["steady"]]
        known = rows[list(PARAMETERS)].dropna(axis=1, how="all")
        feet[foot] = {"strides": len(rows)}
        if len(rows) >= MIN_STRIDES:
            feet[foot] |= {"mean": known.mean().to_dict(), "sd": known.std().to_dict()}
    if {"left", "right"} <= feet.keys() and all("mean" in of for of in feet.values()):
        left, right = feet["left"]["mean"], feet["right"]["mean"]
        shared = [name for name in COMPARED if name in left and name in right]
        asymmetry = {name: 200.0 * (right[name] - left[name]) / (right[name] + left[name]) for name in shared}
        feet["asymmetry_percent"] = asymmetry
    return feet
