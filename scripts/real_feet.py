"""How real feet stand: the rolling lever, the marker, the sinking sole, measured on the motion-captured walks.

    python scripts/real_feet.py [--data DIR] [--per-walk]

Motion capture follows a marker, not the sensor. On each Vicon trial, with PyShoe's labels as stances and the smoother's
attitude laid on the truth by yaw and shift:

======= =============================================================================================================
lever   of the sensor from the point about which the foot rolls, as `estimate_lever` finds it from the recording alone
own     of the marker: least squares of its velocity in stance on w x l, w below 1 rad/s
offset  marker minus sensor, body axes: least squares of (marker - sensor path) = R d over strides of 0.5 to 2.5 s, each
        less its own line in time, so that drift does not count
sinking of the sensor in mid-stance: vertical velocity of the marker less that of w x d, the median over 17 samples
        about the stillest one
climb   of the smoother against the marker, stance to stance: with plain zero velocity, with the rolling lever, with a
        sole that settles by 1.5 mm in all walks as well, and with level floors in place of that (the default)
======= =============================================================================================================

Figures are medians over the trials of a day, and over all, that have 10 such strides or more; of the climb also its
median size, and its scatter from trial to trial. Gait and mounting differ from day to day; some trials are of running.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import harness
import numpy as np
import walks
from walks import Walk

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.rest import estimate_lever
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import PLAIN, WalkParameters
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth

ROLLING_RAD_S, ROLLING_M_S = 1.0, 0.3  # Above these the foot no longer rolls on the ground.

STRIDE_S = (0.5, 2.5)
MIN_STRIDES = 10
REACH = 8  # Samples on either side of the stillest one.

FREE = SmootherParameters(walk=WalkParameters(floors=False))

VARIANTS: Mapping[str, SmootherParameters] = {
    "plain": PLAIN,
    "rolling": replace(FREE, settling_sigma_m=PLAIN.settling_sigma_m),
    "settling too": replace(FREE, settling_m=0.0015, settling_sigma_m=PLAIN.settling_sigma_m),
    "level floors": SmootherParameters(),
}


@dataclass(frozen=True)
class Foot:
    """What a trial shows: `lever`, `own`, `offset` (3,) m; `sinking` m/s; `climb` m a stride, one a variant."""

    trial: str
    lever: Floats
    own: Floats
    offset: Floats
    sinking: float
    climb: Floats


ARRAYS = ("lever", "own", "offset", "climb")


@dataclass(frozen=True)
class Seen:
    """A trial on the samples which the truth saw: attitude and both paths in the truth's frame, rate in body axes."""

    t: Floats
    nav_R_body: Floats
    sensor: Floats
    marker: Floats
    rate: Floats
    stands: Bools
    stillest: Ints


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, per_walk=False)
    trials = walks.read_vicon_labelled(walks.data_folder(chosen.data))
    feet = [foot for walk in trials if (foot := measure_trial(walk)) is not None]
    days = {day: [foot for foot in feet if foot.trial.startswith(day)] for day in sorted({f.trial[:10] for f in feet})}
    shown = feet if chosen.per_walk else [_middle(f"{day} ({len(of)} trials)", of) for day, of in days.items()]
    shown.append(_middle(f"all ({len(feet)} of {len(trials)} trials)", feet))
    harness.print_heading("How real feet stand: levers x y z (mm), sinking (mm/s), climb (mm a stride)")
    harness.print_table(("median of", *_cells(feet[0])), [[foot.trial, *_cells(foot).values()] for foot in shown])
    size = [f"{1e3 * np.median([abs(foot.climb[k]) for foot in feet]):.1f}, {name}" for k, name in enumerate(VARIANTS)]
    print(f"size of the climb, median over all (mm a stride): {'; '.join(size)}")
    apart = [f"{1e3 * np.std([foot.climb[k] for foot in feet]):.1f}, {name}" for k, name in enumerate(VARIANTS)]
    print(f"scatter of the climb, over all (mm a stride): {'; '.join(apart)}")


def _middle(name: str, feet: Sequence[Foot]) -> Foot:
    lever, own, offset, climb = (np.median([getattr(f, n) for f in feet], axis=0) for n in ARRAYS)
    return Foot(name, lever, own, offset, float(np.median([foot.sinking for foot in feet])), climb)


def measure_trial(walk: Walk) -> Foot | None:
    """Measure a trial; None if it has too few strides."""
    truth, stances = walk.recording.truth, walk.stances
    assert isinstance(truth, TrajectoryTruth)
    seen = _seen(walk, smooth(walk.recording, stances), truth)
    strides = [(i, j) for i, j in pairwise(seen.stillest) if STRIDE_S[0] < seen.t[j] - seen.t[i] < STRIDE_S[1]]
    if len(strides) < MIN_STRIDES:
        return None
    offset = _offset(seen, strides)
    climb = [_climb(smooth(walk.recording, stances, p), truth) for p in VARIANTS.values()]
    lever = estimate_lever(walk.recording, stances).lever
    return Foot(walk.name, lever, _own_lever(seen), offset, _sinking(seen, offset), np.array(climb))


def _seen(walk: Walk, solution: Solution, truth: TrajectoryTruth) -> Seen:
    row, marker = interpolate_truth(truth, solution.t)
    alignment = align(solution.position[row], marker)
    still = walk.stances.stillest(walk.recording.gyr)
    return Seen(
        t=solution.t[row],
        nav_R_body=alignment.rotate(solution.nav_R_body[row]),
        sensor=alignment.apply(solution.position[row]),
        marker=marker,
        rate=walk.recording.gyr[row] - solution.stances.gyro_bias.mean(axis=0),
        stands=walk.stances.mask[row],
        stillest=np.searchsorted(row, still[np.isin(still, row)]),
    )


def _offset(seen: Seen, strides: Sequence[tuple[int, int]]) -> Floats:
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for i, j in strides:
        line, _ = np.linalg.qr(np.stack([np.ones(j - i), seen.t[i:j] - seen.t[i]], axis=1))
        between = (seen.marker - seen.sensor)[i:j]
        turn = seen.nav_R_body[i:j].reshape(-1, 9)
        y = between - line @ (line.T @ between)
        A = (turn - line @ (line.T @ turn)).reshape(-1, 3, 3)
        normal += np.einsum("nij,nik->jk", A, A)
        right += np.einsum("nij,ni->j", A, y)
    return np.linalg.solve(normal, right)


def _own_lever(seen: Seen) -> Floats:
    velocity = np.gradient(seen.marker, seen.t, axis=0)
    rolls = seen.stands & (np.linalg.norm(seen.rate, axis=1) < ROLLING_RAD_S)
    rolls &= np.linalg.norm(velocity, axis=1) < ROLLING_M_S
    body_velocity = np.einsum("nji,nj->ni", seen.nav_R_body[rolls], velocity[rolls])
    design = np.stack([np.cross(seen.rate[rolls], axis) for axis in np.eye(3)], axis=2)  # w x l = design l
    return np.asarray(np.linalg.lstsq(design.reshape(-1, 3), body_velocity.reshape(-1), rcond=None)[0])


def _sinking(seen: Seen, offset: Floats) -> float:
    arm = np.einsum("nij,nj->ni", seen.nav_R_body, np.cross(seen.rate, offset))
    up = (np.gradient(seen.marker, seen.t, axis=0) - arm)[:, 2]
    return -float(np.median([np.median(up[max(i - REACH, 0) : i + REACH + 1]) for i in seen.stillest]))


def _climb(solution: Solution, truth: TrajectoryTruth) -> float:
    row, marker = interpolate_truth(truth, solution.stances.t)
    error = solution.stances.position[row, 2] - marker[:, 2]
    return float(error[-1] - error[0]) / max(len(row) - 1, 1)


def _cells(foot: Foot) -> dict[str, str]:
    levers = {"sensor's lever": foot.lever, "marker's own lever": foot.own, "marker minus sensor": foot.offset}
    cells = {name: " ".join(f"{1e3 * v:.0f}" for v in value) for name, value in levers.items()}
    climbs = zip(VARIANTS, foot.climb, strict=True)
    return cells | {"sinking": f"{1e3 * foot.sinking:.1f}"} | {f"climb, {name}": f"{1e3 * v:.1f}" for name, v in climbs}


if __name__ == "__main__":
    harness.run(main)
