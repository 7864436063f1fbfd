"""What a gap in a swing costs: samples held, interpolated, or learned from the rest of the recording.

    python scripts/lost_samples.py [RECORDING ...] [--strides N] [--seed N] [--mount NAME] [--rate HZ]

A noise-free walk, of which up to 8 per cent of the samples are lost, in gaps as wide as the row says, one at a time.
Each gap is integrated from the true state before it and compared with the true state after it. Only gaps in a swing
count: where the foot turns by more than 2 rad/s. Of recordings, averaged down to the rate, the true attitude is not
known: there it is the angle, all axes, by which what the bridge says was turned misses what the lost samples read.

============ =========================================================================
held         the sample before the gap stands for all of it
interpolated the mean of the two samples beside it
learned      what `fg_nav.samples.gaps` makes of it; the error over its sigma, rms over all axes
============ =========================================================================
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import figures as fig
import numpy as np
from kinematic_consistency import section
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation.foot import FootMotion, foot_motion
from fg_nav.lab.simulation.footsteps import Style
from fg_nav.lab.simulation.person import MOUNTS, Mount, Person, mount_named
from fg_nav.lab.simulation.plan import Stand, plan
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.samples.coning import compensated
from fg_nav.samples.gaps import bridged

LOST = (1, 2, 3, 4)
WAYS = ("held", "interpolated", "learned")
APART = 50
"""Samples from one gap to the next."""
SWING_RAD_S = 2.0


@dataclass(frozen=True)
class Samples:
    """Samples (N, 3) at stamps `t` (N,) s, one every `period_s`."""

    period_s: float
    t: Floats
    acc: Floats
    gyr: Floats


@dataclass(frozen=True)
class Walked(Samples):
    """And the foot that they are of."""

    motion: FootMotion


@dataclass(frozen=True)
class Missed:
    """Of G gaps: error of yaw (G,) deg, tilt (G,) deg and velocity (G,) m/s at the next sample."""

    yaw_deg: Floats
    tilt_deg: Floats
    velocity: Floats

    def words(self) -> list[str]:
        """Root mean squares, and the largest yaw."""
        rms = [np.sqrt(np.mean(some**2)) for some in (self.yaw_deg, self.tilt_deg, self.velocity)]
        return [f"{rms[0]:.3f} ({np.abs(self.yaw_deg).max():.2f})", f"{rms[1]:.3f}", f"{rms[2]:.3f}"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What lost samples cost, and what making them good is worth.")
    parser.add_argument("recordings", nargs="*", type=Path, metavar="RECORDING", help="in place of a simulated walk")
    parser.add_argument("--strides", type=int, default=300, metavar="N", help="of a walk (300)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="draws strides, motion and gaps (1)")
    parser.add_argument("--mount", default="heel", help=f"{' or '.join(MOUNTS)}")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="of the samples (100)")
    chosen = parser.parse_args(arguments)
    rng = np.random.default_rng(chosen.seed)
    if chosen.recordings:
        fig.print_heading(f"Missed in a gap in a swing, {chosen.rate:.0f} Hz: rms")
        table = [row for path in chosen.recordings for lost in LOST for row in real_rows(path, chosen.rate, lost, rng)]
        fig.print_table(("walk", "lost", *WAYS, "error over sigma"), table)
        return
    walked = walk(chosen.strides, mount_named(chosen.mount), chosen.rate, rng)
    fig.print_heading(f"Left of a gap in a swing, {chosen.rate:.0f} Hz: rms (largest)")
    columns = ("lost", "way", "yaw, deg", "tilt, deg", "velocity, m/s", "error over sigma")
    fig.print_table(columns, [row for lost in LOST for row in rows(walked, lost, rng)])


def walk(count: int, mount: Mount, rate_hz: float, rng: np.random.Generator) -> Walked:
    """Some strides of the default person straight ahead."""
    person = Person()
    strides = plan([Stand(1.0), section(Style.WALK, count, person)], person, rng)
    motion = foot_motion(strides, person, mount, rng)
    t = np.arange(int(strides.end_s * rate_hz)) / rate_hz
    rate, force = motion.sampled(t, 1 / rate_hz)
    return Walked(1 / rate_hz, t, force, rate, motion)


def real_rows(path: Path, rate_hz: float, lost: int, rng: np.random.Generator) -> list[list[str]]:
    """One row for a recording and a length of gap: deg by each way."""
    recording = read(path)
    each = max(1, round(1 / (recording.period_s * rate_hz)))
    count = len(recording) // each
    acc, gyr = (some[: count * each].reshape(count, each, 3).mean(axis=1) for some in (recording.acc, recording.gyr))
    period = each * recording.period_s
    samples = Samples(period, np.arange(float(count)) * period, acc, gyr)
    before, kept = gaps_in(count, lost, rng)
    ways, z = bridges(samples, before, kept, lost)
    swings = swinging(samples, before)
    truth = np.mean([gyr[before + k] for k in range(1, lost + 1)], axis=0)
    errors = [np.linalg.norm((rate - truth)[swings], axis=1) * lost * period for _, rate in ways.values()]
    rms = [f"{np.degrees(np.sqrt(np.mean(some**2))):.3f}" for some in errors]
    return [[path.name, str(lost), *rms, f"{np.sqrt(np.mean(z**2)):.2f}"]]


def gaps_in(count: int, lost: int, rng: np.random.Generator) -> tuple[Ints, Bools]:
    """Samples (G,) before gaps, and which of all (N,) are kept."""
    places = np.arange(1, (count - lost) // APART) * APART
    before = places + rng.integers(APART // 2, size=len(places))
    kept = np.ones(count, dtype=np.bool_)
    kept[(before[:, None] + np.arange(1, lost + 1)).ravel()] = False
    return before, kept


def rows(walked: Walked, lost: int, rng: np.random.Generator) -> list[list[str]]:
    """One row a way to bridge the gaps."""
    before, kept = gaps_in(len(walked.t), lost, rng)
    ways, z = bridges(walked, before, kept, lost)
    table = [[str(lost), name, *missed(walked, before, lost, *unseen).words(), ""] for name, unseen in ways.items()]
    table[-1][-1] = f"{np.sqrt(np.mean(z**2)):.2f}"
    return table


def bridges(
    walked: Samples, before: Ints, kept: Bools, lost: int
) -> tuple[Mapping[str, tuple[Floats, Floats]], Floats]:
    """Means of acc and gyr (G, 3) in the gaps, by each way; and the last one's errors over its sigmas (G, 6)."""
    after = before + lost + 1
    gaps = bridged(walked.t[kept], walked.acc[kept], walked.gyr[kept])
    both = np.hstack([walked.acc, walked.gyr])
    truth = np.mean([both[before + k] for k in range(1, lost + 1)], axis=0)
    z = (np.hstack([gaps.acc, gaps.gyr]) - truth) / np.hstack([gaps.acc_sigma, gaps.gyr_sigma])
    ways = {
        "held": (walked.acc[before], walked.gyr[before]),
        "interpolated": (
            (walked.acc[before] + walked.acc[after]) / 2,
            (walked.gyr[before] + walked.gyr[after]) / 2,
        ),
        "learned": (gaps.acc, gaps.gyr),
    }
    return ways, z[swinging(walked, before)]


def swinging(walked: Samples, before: Ints) -> Bools:
    """Which gaps (G,) are in a swing."""
    return np.asarray(np.linalg.norm(walked.gyr[before], axis=1) > SWING_RAD_S)


def missed(walked: Walked, before: Ints, lost: int, acc: Floats, gyr: Floats) -> Missed:
    """What integration over each gap in a swing misses, given the means (G, 3) in it."""
    errors = [
        _missed(walked, int(i), lost, f, w)
        for i, f, w, swings in zip(before, acc, gyr, swinging(walked, before), strict=True)
        if swings
    ]
    turn, velocity = (np.array(some) for some in zip(*errors, strict=True))
    turn = np.degrees(turn)
    return Missed(turn[:, 2], np.linalg.norm(turn[:, :2], axis=1), np.linalg.norm(velocity, axis=1))


def _missed(walked: Walked, i: int, lost: int, acc: Floats, gyr: Floats) -> tuple[Floats, Floats]:
    """Errors (3,) of attitude, rad in nav, and velocity, m/s, after the gap behind sample `i`."""
    j, period = i + lost + 1, walked.period_s
    around = [i - 1, i, j]
    f, w, h = walked.acc[around], walked.gyr[around], period * np.array([1.0, lost + 1.0, 1.0])
    f[1], w[1] = (f[1] + lost * acc) / (lost + 1), (w[1] + lost * gyr) / (lost + 1)
    f, w = compensated(f, w, h)
    ends = walked.motion.at(walked.t[[i, j]])
    state = NavState(ends.position[0], ends.velocity[0], ends.nav_R_body[0], np.zeros(3), np.zeros(3))
    strapdown(state, f[1], w[1], h[1], GRAVITY_M_S2, np.empty((3, 3)), np.empty(3))
    turn = Rotation.from_matrix(state.nav_R_body @ ends.nav_R_body[1].T).as_rotvec()
    return turn, state.velocity - ends.velocity[1]


if __name__ == "__main__":
    fig.leave_with(main)
