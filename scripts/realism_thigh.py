"""The simulated thigh beside a real one: swing, rates, forces and cadence, stride by stride.

    python scripts/realism_thigh.py [--data DIR] [--seed N]

Real: both thighs of the one subject of `qmt_fullbody`, 97 to 138 s, walking, at 100 Hz; how the sensors were
fastened is not recorded. Simulated: 300 m straight ahead with the default pocket, sampled at 100 Hz, without noise.

A stride begins at heel-off, where the rate of the foot on the same side rises above 60 deg/s before push-off. Axes are
those of the thigh: across (flexion), along the bone (twist), forward (abduction). Flexion is the angle of the vertical
about the axis across; the recording's own attitudes are those of a body model and not used. Slow rates and forces are
low-passed, at 6 and 15 Hz, which takes most of the fast trembling. A row shows the median over the strides
and the 5 to 95 % range; `ok` where the simulated median lies within the real range.

The defaults were set with this table in view: `ok` says that the fit holds, not that other people walk so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from scipy.io import loadmat
from scipy.signal import butter, filtfilt, find_peaks
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Stand, Walk, plan
from fg_nav.lab.simulation.thigh import Pocket, build_thigh_motion

RATE_HZ = 100.0
SITTING_S = (60.0, 70.0)
WALKING_S = (97.0, 138.0)
STRIDES_S = (0.8, 1.1)

STRAP = "strap"
WHY = dict.fromkeys(
    (
        "peak rate across",
        "rate forward, rms",
        "rate along the bone, slow, rms",
        "rate along the bone, rms",
    ),
    STRAP,
)
"""Rows that the defaults leave below the real range. A guess, not tested: the real sensor is loosely strapped and
twists round the thigh; one in a pocket, or on Munoz Diaz's board, may be held better."""


@dataclass(frozen=True)
class Thigh:
    """A walking thigh at N instants.

    `t` (N,) s; `flexion` (N,) rad; `rate` (N, 3) rad/s forward, across (flexing) and along the bone; `force` (N,)
    m/s^2; `heel_off` (K,) indices.
    """

    t: Floats
    flexion: Floats
    rate: Floats
    force: Floats
    heel_off: Ints


def real_strides(data: Path) -> dict[str, Floats]:
    """Figures of each stride of both real thighs, by name."""
    path = data / "qmt_fullbody" / "full_body_example_data.mat"
    body = loadmat(path, squeeze_me=True, struct_as_record=False)
    legs = [strides_of(real_thigh(body, side)) for side in ("left", "right")]
    return {name: np.concatenate([leg[name] for leg in legs]) for name in legs[0]}


def real_thigh(body: dict[str, Any], side: str) -> Thigh:
    """One thigh of the subject; its sensor has x up the bone, y forward or back, z across."""
    inside = (body["t"] > WALKING_S[0]) & (body["t"] < WALKING_S[1])
    sitting = (body["t"] > SITTING_S[0]) & (body["t"] < SITTING_S[1])
    leg, foot = body[f"upper_leg_{side}"], body[f"foot_{side}"]
    forward = np.sign(leg.acc[sitting, 1].mean())  # the thigh of one who sits points forward
    up = upward(leg.gyr, leg.acc)[inside]
    flexion = np.arctan2(forward * up[:, 1], up[:, 0])
    gyr = leg.gyr[inside]
    rate = np.stack([forward * gyr[:, 1], -forward * gyr[:, 2], gyr[:, 0]], axis=1)
    force = np.linalg.norm(leg.acc[inside], axis=1)
    return Thigh(body["t"][inside], flexion, rate, force, heel_offs(foot.gyr[inside]))


def upward(gyr: Floats, acc: Floats, below_hz: float = 0.1) -> Floats:
    """Direction of up (N, 3) in the body: the force, slow in the frame that the gyroscopes carry on (as VQF does)."""
    still_R_body = [Rotation.identity()]
    for step in Rotation.from_rotvec(gyr / RATE_HZ):
        still_R_body.append(still_R_body[-1] * step)
    attitude = Rotation.concatenate(still_R_body[:-1])
    vertical = _slow(attitude.apply(acc), below_hz)
    up: Floats = attitude.inv().apply(vertical / np.linalg.norm(vertical, axis=1, keepdims=True))
    return up


def simulated_thigh(seed: int) -> Thigh:
    """A thigh of ours on a straight way."""
    rng = np.random.default_rng(seed)
    strides = plan([Stand(2.0), Walk(straight(300.0)), Stand(2.0)], Person(), rng)
    motion = build_thigh_motion(strides, Pocket(), rng)
    t = np.arange(0.0, strides.end_s, 1 / RATE_HZ)
    rate, force = motion.sampled(t, 1 / RATE_HZ)
    thigh_rate = rate @ motion.thigh_R_body.T
    up = motion.at(t).nav_R_body[:, 2] @ motion.thigh_R_body.T
    heel_off = np.searchsorted(t, strides.start[2:-2])
    across = thigh_rate * np.array([1.0, -1.0, 1.0])
    return Thigh(t, np.arctan2(up[:, 0], up[:, 2]), across, np.linalg.norm(force, axis=1), heel_off)


def heel_offs(foot_rate: Floats) -> Ints:
    """Indices at which a foot begins to push off: its rate (N, 3) passes 60 deg/s before the peak of push-off."""
    across = _slow(foot_rate[:, 1], 12.0)
    push = -across if -across.min() > across.max() else across
    size = np.linalg.norm(foot_rate, axis=1)
    peaks, _ = find_peaks(push, height=np.deg2rad(400.0), distance=60)
    still = np.flatnonzero(size < np.deg2rad(60.0))
    return still[np.searchsorted(still, peaks) - 1]


def strides_of(thigh: Thigh) -> dict[str, Floats]:
    """Figures (K,) of each whole stride, by name."""
    found = [_stride(thigh, a, b) for a, b in pairwise(thigh.heel_off) if _is_stride(thigh.t[b] - thigh.t[a])]
    return {name: np.array([stride[name] for stride in found]) for name in found[0]}


def _stride(thigh: Thigh, begin: int, end: int) -> dict[str, float]:
    part = slice(begin, end)
    flexion, rate = np.degrees(thigh.flexion[part]), np.degrees(thigh.rate[part])
    slow = np.degrees(_slow(thigh.rate, 6.0)[part])
    force, slow_force = thigh.force[part], _slow(thigh.force, 15.0)[part]
    return {
        "stride (s)": float(thigh.t[end] - thigh.t[begin]),
        "swing of flexion (deg)": float(np.ptp(flexion)),
        "most extended at share": float(np.argmin(flexion) / len(flexion)),
        "peak flexing, slow (deg/s)": float(slow[:, 1].max()),
        "peak extending, slow (deg/s)": float(-slow[:, 1].min()),
        "peak rate across (deg/s)": float(np.abs(rate[:, 1]).max()),
        "rate across, rms (deg/s)": _rms(rate[:, 1]),
        "rate forward, rms (deg/s)": _rms(rate[:, 0]),
        "rate along the bone, slow, rms (deg/s)": _rms(slow[:, 2]),
        "rate along the bone, rms (deg/s)": _rms(rate[:, 2]),
        "least force (m/s^2)": float(force.min()),
        "peak force, slow (m/s^2)": float(slow_force.max()),
        "peak force (m/s^2)": float(force.max()),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, seed=1)
    real = real_strides(walks.data_folder(chosen.data))
    harness.print_heading("A real thigh and the simulated one: median (5 to 95 % of the strides)")
    rows = [_row(name, real[name], ours) for name, ours in strides_of(simulated_thigh(chosen.seed)).items()]
    harness.print_table(("of a stride", "real", "simulated", ""), rows)
    print(f"{STRAP}: less than real, left so on purpose; a guess, not tested: a loose strap adds motion")


def _row(name: str, real: Floats, ours: Floats) -> tuple[str, str, str, str]:
    return name, _middle_and_range(real), _middle_and_range(ours), judged(name, real, ours)


def judged(name: str, real: Floats, ours: Floats) -> str:
    """`ok`, why the simulated median lies below the real range, or `outside`."""
    low, high = np.percentile(real, [5, 95])
    middle = np.median(ours)
    if low <= middle <= high:
        return "ok"
    return WHY.get(name.split(" (")[0], "outside") if middle < low else "outside"


def _middle_and_range(values: Floats) -> str:
    low, middle, high = np.percentile(values, [5, 50, 95])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def _is_stride(seconds: float) -> bool:
    return STRIDES_S[0] < seconds < STRIDES_S[1]


def _slow(values: Floats, below_hz: float) -> Floats:
    slow: Floats = filtfilt(*butter(2, below_hz, fs=RATE_HZ), values, axis=0)
    return slow


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    harness.run(main)
