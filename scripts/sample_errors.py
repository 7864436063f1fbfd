"""What samples of a foot hide and lose, and what is left when it is made good.

    python scripts/sample_errors.py integration [--strides N] [--mount NAME]
    python scripts/sample_errors.py preintegration
    python scripts/sample_errors.py gaps [RECORDING ...] [--strides N] [--mount NAME] [--rate HZ]
    python scripts/sample_errors.py peaks [RECORDING ...] [--strides N] [--mount NAME] [--rate HZ]

A sample is the mean of rate and specific force over its period; simulated ones are without noise.

integration
    Strapdown integration that is exact for constant rate and force (`fg_nav.mechanisation`) starts from the true state
    at the beginning of each stride and is compared with the true one at its end. "plain" takes the samples as they are:
    what is left is the motion within a sample. With w, f and their rates of change, a sample of period h misses
    the angle h^3/12 w x w' (coning) and the velocity h^3/12 (w x f' - w' x f) (sculling), second order in the period.
    "corrected" has the two terms added, as every estimator has them (`fg_nav.samples.gaps`):
    what is left is of fourth order, and shows that samples and truth agree.

preintegration
    Each stride of the demonstration, from mid-stance to mid-stance, is preintegrated from the true state at its start
    by GTSAM's default class and by the Galilean one; the velocity that they predict at its end is compared with the
    true one.

gaps
    Up to 8 per cent of the samples are lost, in gaps as wide as the row says. Each gap in a swing (the foot turns by
    more than 2 rad/s) is integrated from the true state before it and compared with the true state after it. "held":
    the sample before the gap stands for all of it; "interpolated": the mean of the two next to it; "learned": what
    `fg_nav.samples.gaps` makes of it, with the error over its sigma, rms over all axes. Of recordings, averaged down to
    the rate, the true attitude is not known: there it is the angle by which the bridge misses the samples left out.

peaks
    The axis that turns fastest is clipped at a share of its median peak, and so is the one with the largest force. What
    is hidden is the angle of each peak, deg, or its change of velocity, m/s. What is left when they are rebuilt
    (`fg_nav.samples.readings`) over its sigma is 1 where the sigma is true.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import gtsam
import harness
import numpy as np
from harness import option
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation import routes
from fg_nav.lab.simulation.foot import FootMotion, build_foot_motion
from fg_nav.lab.simulation.motion import Kinematics, Strides, Style
from fg_nav.lab.simulation.mount import INSTEP, MOUNTS, Mount, find_mount
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, plan
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.samples.gaps import compensate_coning, fill_gaps
from fg_nav.samples.readings import rebuild_peaks
from fg_nav.system.compiled import njit


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one of the four."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        what=option(None, "what to measure", choices=tuple(EXPERIMENTS), positional=True),
        recordings=option([], "in place of a simulated walk", nargs="*", type=Path, positional=True),
        strides=option(200, "strides of a walk", metavar="N"),
        seed=1,
        mount=option("instep", " or ".join(MOUNTS)),
        rate=option(100.0, "of the samples", metavar="HZ"),
    )
    if chosen.strides < 1:
        raise SimulationError(f"{chosen.strides} strides show nothing: ask for one or more.")
    EXPERIMENTS[chosen.what](chosen)


# --- integration -----------------------------------------------------------------------------------------------------

RATES_HZ = (100.0, 200.0, 400.0, 800.0)
QUANTITIES = ("attitude, mdeg", "velocity, mm/s", "position, mm")


def print_integration(chosen: argparse.Namespace) -> None:
    """Print what exact integration leaves of a stride of each style."""
    harness.print_heading("Left over at the end of a stride: median (most)")
    columns = ("stride", "samples", "error", *(f"{rate:.0f} Hz" for rate in RATES_HZ), "ratios of medians")
    harness.print_table(columns, [row for style in Style for row in integration_rows(chosen, style)])


def integration_rows(chosen: argparse.Namespace, style: Style) -> list[list[str]]:
    """One row a quantity and way of integration."""
    rng = np.random.default_rng(chosen.seed)
    person = Person()
    strides = plan([Stand(1.0), section_of(style, chosen.strides, person)], person, rng)
    motion = build_foot_motion(strides, person, find_mount(chosen.mount), rng)
    table = []
    for corrected in (False, True):
        sizes = [np.linalg.norm(integration_errors(motion, strides, r, corrected), axis=2) for r in RATES_HZ]
        medians, most = (np.array([pick(size, axis=0) for size in sizes]) for pick in (np.median, np.max))
        for i, name in enumerate(QUANTITIES):
            words = [f"{m:.3f} ({x:.3f})" for m, x in zip(medians[:, i], most[:, i], strict=True)]
            ratios = " ".join(f"{a / b:.1f}" for a, b in pairwise(medians[:, i]))
            kind = "corrected" if corrected else "plain"
            table.append([style.name.lower().replace("_", " "), kind, name, *words, ratios])
    return table


def section_of(style: Style, count: int, person: Person) -> Section:
    """About `count` strides of a style."""
    if style in (Style.WALK, Style.RUN):
        return Walk(straight(person.gait(style).stride_m * count), style)
    if style is Style.TURN:
        return TurnOnSpot(np.pi / 4 * count)
    return Stairs(2 * count, up=style is Style.STAIRS_UP)


def integration_errors(motion: FootMotion, strides: Strides, rate_hz: float, corrected: bool = False) -> Floats:
    """Error (K, 3, 3) at the end of each stride: of attitude, mdeg; of velocity, mm/s; of position, mm."""
    first = np.ceil(strides.start * rate_hz)
    last = np.floor((strides.start + strides.duration) * rate_hz)
    spans = (np.arange(i, j + 1) / rate_hz for i, j in zip(first, last, strict=True))
    return np.array([_error_over(motion, t, 1 / rate_hz, corrected) for t in spans])


def _error_over(motion: FootMotion, t: Floats, period_s: float, corrected: bool) -> Floats:
    rate, force = motion.sampled(t[:-1], period_s)
    if corrected:
        force, rate = compensate_coning(force, rate, np.full(len(rate), period_s))
    ends = motion.at(t[[0, -1]])
    state = NavState(ends.position[0], ends.velocity[0], ends.nav_R_body[0], np.zeros(3), np.zeros(3))
    integrate(state, force, rate, period_s)
    turned = state.nav_R_body.T @ ends.nav_R_body[1]
    turn = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    return 1e3 * np.stack([np.rad2deg(turn), state.velocity - ends.velocity[1], state.position - ends.position[1]])


@njit(cache=True)
def integrate(state: NavState, force: Floats, rate: Floats, period_s: float) -> None:
    """Move `state` over samples (N, 3) of specific force and rate."""
    turn, push = np.empty((3, 3)), np.empty(3)
    for n in range(len(rate)):
        strapdown(state, force[n], rate[n], period_s, GRAVITY_M_S2, turn, push)


# --- preintegration --------------------------------------------------------------------------------------------------

CLASSES: Mapping[str, Any] = {
    "default (tangent space)": gtsam.PreintegratedImuMeasurements,
    "Galilean": gtsam.PreintegratedImuMeasurementsG,
}


def print_preintegration(chosen: argparse.Namespace) -> None:
    """Print the velocity error at the end of a stride, root mean square over the strides."""
    rng, person = np.random.default_rng(chosen.seed), Person()
    motion = build_foot_motion(plan(routes.demo(), person, rng), person, INSTEP, rng)
    errors = [preintegration_errors(motion, rate_hz) for rate_hz in RATES_HZ[:3]]
    rows = [[name, *(f"{1e3 * _rms_norm(error[name]):.2f}" for error in errors)] for name in CLASSES]
    harness.print_heading(f"Velocity error at the end of {len(errors[0]['Galilean'])} strides, rms (mm/s)")
    harness.print_table(("preintegration", *(f"{rate_hz:g} Hz" for rate_hz in RATES_HZ[:3])), rows)


def preintegration_errors(motion: FootMotion, rate_hz: float) -> dict[str, Floats]:
    """Predicted less true velocity (S, 3) m/s at the end of each stride, by class."""
    cuts: Ints = (motion.flat.mean(axis=1) * rate_hz).astype(np.int64)
    t = np.arange(cuts[-1] + 1) / rate_hz
    samples, truth = motion.sampled(t, 1 / rate_hz), motion.at(t)
    strides = list(pairwise(cuts))
    return {
        name: np.array([_predict(kind, samples, truth, i, j, rate_hz) - truth.velocity[j] for i, j in strides])
        for name, kind in CLASSES.items()
    }


def _predict(kind: Any, samples: tuple[Floats, Floats], truth: Kinematics, i: int, j: int, rate_hz: float) -> Floats:
    measurement = kind(gtsam.PreintegrationParams.MakeSharedU(GRAVITY_M_S2))
    for rate, force in zip(samples[0][i:j], samples[1][i:j], strict=True):
        measurement.integrateMeasurement(force, rate, 1 / rate_hz)
    start = gtsam.NavState(gtsam.Rot3(truth.nav_R_body[i]), truth.position[i], truth.velocity[i])
    return np.asarray(measurement.predict(start, gtsam.imuBias.ConstantBias()).velocity())


def _rms_norm(errors: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


# --- gaps ------------------------------------------------------------------------------------------------------------

LOST = (1, 2, 3, 4)
BRIDGES = ("held", "interpolated", "learned")
APART = 50  # Samples from one gap to the next.
SWING_RAD_S = 2.0


@dataclass(frozen=True)
class Samples:
    """Samples (N, 3) at stamps `t` (N,) s, one every `period_s`; and the foot that they are of, if it is simulated."""

    period_s: float
    t: Floats
    acc: Floats
    gyr: Floats
    motion: FootMotion | None = None

    def swings(self, before: Ints) -> Bools:
        """Which gaps (G,) behind these samples are in a swing."""
        return np.asarray(np.linalg.norm(self.gyr[before], axis=1) > SWING_RAD_S)


def simulate_samples(count: int, mount: Mount, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Some strides of the default person straight ahead."""
    person = Person()
    strides = plan([Stand(1.0), section_of(Style.WALK, count, person)], person, rng)
    motion = build_foot_motion(strides, person, mount, rng)
    t = np.arange(int(strides.end_s * rate_hz)) / rate_hz
    rate, force = motion.sampled(t, 1 / rate_hz)
    return Samples(1 / rate_hz, t, force, rate, motion)


def read_samples(path: Path, rate_hz: float) -> Samples:
    """Read a recording, averaged down to about this rate."""
    recording = read(path)
    each = max(1, round(1 / (recording.period_s * rate_hz)))
    count = len(recording) // each
    acc, gyr = (some[: count * each].reshape(count, each, 3).mean(axis=1) for some in (recording.acc, recording.gyr))
    period = each * recording.period_s
    return Samples(period, np.arange(float(count)) * period, acc, gyr)


def print_gaps(chosen: argparse.Namespace) -> None:
    """Print what gaps in swings cost."""
    rng = np.random.default_rng(chosen.seed)
    if chosen.recordings:
        harness.print_heading(f"Missed in a gap in a swing, {chosen.rate:.0f} Hz: rms, deg")
        table = [real_gap_row(path, chosen.rate, lost, rng) for path in chosen.recordings for lost in LOST]
        harness.print_table(("walk", "lost", *BRIDGES, "error over sigma"), table)
        return
    walked = simulate_samples(chosen.strides, find_mount(chosen.mount), chosen.rate, rng)
    harness.print_heading(f"Left of a gap in a swing, {chosen.rate:.0f} Hz: rms (largest)")
    columns = ("lost", "bridge", "yaw, deg", "tilt, deg", "velocity, m/s", "error over sigma")
    harness.print_table(columns, [row for lost in LOST for row in gap_rows(walked, lost, rng)])


def real_gap_row(path: Path, rate_hz: float, lost: int, rng: np.random.Generator) -> list[str]:
    """One row for a recording and a width of gap."""
    samples = read_samples(path, rate_hz)
    before, kept = draw_gaps(len(samples.t), lost, rng)
    means, z = bridge_gaps(samples, before, kept, lost)
    truth = np.mean([samples.gyr[before + k] for k in range(1, lost + 1)], axis=0)
    missed = [np.linalg.norm((rate - truth)[samples.swings(before)], axis=1) for _, rate in means.values()]
    rms = [f"{np.degrees(_rms(some * lost * samples.period_s)):.3f}" for some in missed]
    return [path.name, str(lost), *rms, f"{_rms(z):.2f}"]


def draw_gaps(count: int, lost: int, rng: np.random.Generator) -> tuple[Ints, Bools]:
    """Samples (G,) before gaps, and which of all (N,) are kept."""
    places = np.arange(1, (count - lost) // APART) * APART
    before = places + rng.integers(APART // 2, size=len(places))
    kept = np.ones(count, dtype=np.bool_)
    kept[(before[:, None] + np.arange(1, lost + 1)).ravel()] = False
    return before, kept


def gap_rows(walked: Samples, lost: int, rng: np.random.Generator) -> list[list[str]]:
    """One row a bridge."""
    before, kept = draw_gaps(len(walked.t), lost, rng)
    means, z = bridge_gaps(walked, before, kept, lost)
    table = []
    for name, unseen in means.items():
        yaw, tilt, velocity = gap_errors(walked, before, lost, *unseen)
        words = (f"{_rms(yaw):.3f} ({np.abs(yaw).max():.2f})", f"{_rms(tilt):.3f}", f"{_rms(velocity):.3f}")
        table.append([str(lost), name, *words, f"{_rms(z):.2f}" if name == "learned" else ""])
    return table


def bridge_gaps(
    walked: Samples, before: Ints, kept: Bools, lost: int
) -> tuple[Mapping[str, tuple[Floats, Floats]], Floats]:
    """Means of acc and gyr (G, 3) in the gaps, by each bridge; and the last one's errors over its sigmas (G, 6)."""
    after = before + lost + 1
    gaps = fill_gaps(walked.t[kept], walked.acc[kept], walked.gyr[kept])
    both = np.hstack([walked.acc, walked.gyr])
    truth = np.mean([both[before + k] for k in range(1, lost + 1)], axis=0)
    z = (np.hstack([gaps.acc, gaps.gyr]) - truth) / np.hstack([gaps.acc_sigma, gaps.gyr_sigma])
    means = {
        "held": (walked.acc[before], walked.gyr[before]),
        "interpolated": (
            (walked.acc[before] + walked.acc[after]) / 2,
            (walked.gyr[before] + walked.gyr[after]) / 2,
        ),
        "learned": (gaps.acc, gaps.gyr),
    }
    return means, z[walked.swings(before)]


def gap_errors(walked: Samples, before: Ints, lost: int, acc: Floats, gyr: Floats) -> tuple[Floats, Floats, Floats]:
    """Errors behind each gap in a swing, given the means (G, 3) in it: yaw (G,) deg, tilt (G,) deg, velocity (G,)."""
    errors = [
        _error_behind(walked, int(i), lost, f, w)
        for i, f, w, swings in zip(before, acc, gyr, walked.swings(before), strict=True)
        if swings
    ]
    turn, velocity = (np.array(some) for some in zip(*errors, strict=True))
    turn = np.degrees(turn)
    return turn[:, 2], np.linalg.norm(turn[:, :2], axis=1), np.linalg.norm(velocity, axis=1)


def _error_behind(walked: Samples, i: int, lost: int, acc: Floats, gyr: Floats) -> tuple[Floats, Floats]:
    """Errors (3,) of attitude, rad in nav, and velocity, m/s, after the gap behind sample `i`."""
    assert walked.motion is not None
    j, period = i + lost + 1, walked.period_s
    around = [i - 1, i, j]
    f, w, h = walked.acc[around], walked.gyr[around], period * np.array([1.0, lost + 1.0, 1.0])
    f[1], w[1] = (f[1] + lost * acc) / (lost + 1), (w[1] + lost * gyr) / (lost + 1)
    f, w = compensate_coning(f, w, h)
    ends = walked.motion.at(walked.t[[i, j]])
    state = NavState(ends.position[0], ends.velocity[0], ends.nav_R_body[0], np.zeros(3), np.zeros(3))
    strapdown(state, f[1], w[1], h[1], GRAVITY_M_S2, np.empty((3, 3)), np.empty(3))
    turn = Rotation.from_matrix(state.nav_R_body @ ends.nav_R_body[1].T).as_rotvec()
    return turn, state.velocity - ends.velocity[1]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


# --- peaks -----------------------------------------------------------------------------------------------------------

SHARES = (0.95, 0.85, 0.7, 0.5)  # Of the median peak, where it is clipped.


def print_peaks(chosen: argparse.Namespace) -> None:
    """Print what clipped peaks hide, and what is left of it."""
    if chosen.recordings:
        walks = [(path.name, (one := read(path)).gyr, one.acc, one.period_s) for path in chosen.recordings]
    else:
        rng = np.random.default_rng(chosen.seed)
        walked = simulate_samples(chosen.strides, find_mount(chosen.mount), chosen.rate, rng)
        walks = [("simulated", walked.gyr, walked.acc, walked.period_s)]
    columns = ("walk", "clipped at", "peaks", "hidden", "left when rebuilt", "over sigma")
    harness.print_heading("Angle hidden in a clipped peak, rms, deg")
    harness.print_table(columns, [row for name, gyr, _, h in walks for row in peak_rows(name, np.degrees(gyr), h)])
    harness.print_heading("Change of velocity hidden in a clipped peak, rms, m/s")
    harness.print_table(columns, [row for name, _, acc, h in walks for row in peak_rows(name, acc, h)])


def peak_rows(name: str, samples: Floats, period_s: float) -> list[list[str]]:
    """One row a level, of rates in deg/s or of forces in m/s^2, (N, 3)."""
    axis = int(np.argmax(np.abs(samples).max(axis=0)))
    median = median_peak(np.abs(samples[:, axis]))
    table = []
    for share in SHARES:
        cut = samples.copy()
        cut[:, axis] = np.clip(samples[:, axis], -share * median, share * median)
        found = rebuild_peaks(cut, period_s)
        hidden = missed_of_peaks(samples[:, axis], cut[:, axis], cut[:, axis], period_s)
        left = missed_of_peaks(samples[:, axis], found.whole[:, axis], cut[:, axis], period_s)
        variance = missed_of_peaks(found.sigma[:, axis] ** 2, np.zeros(len(cut)), cut[:, axis], period_s) * period_s
        over_sigma = np.sqrt(np.mean(left[variance > 0] ** 2 / variance[variance > 0]))
        rms = [f"{_rms(some):.2f}" for some in (hidden, left)]
        table.append([name, f"{100 * share:.0f} %", str(len(hidden)), *rms, f"{over_sigma:.2f}"])
    return table


def median_peak(size: Floats) -> float:
    """Median of the peaks of a size (N,) that reach half of the highest."""
    return float(np.median([size[a:b].max() for a, b in _runs(size > size.max() / 2)]))


def missed_of_peaks(whole: Floats, found: Floats, cut: Floats, period_s: float) -> Floats:
    """Angle or change of velocity (P,) by which `found` (N,) misses each peak that was clipped."""
    clipped = np.abs(cut) >= np.abs(cut).max()
    return np.array([(whole - found)[a:b].sum() * period_s for a, b in _runs(clipped)])


def _runs(flags: Bools) -> list[tuple[int, int]]:
    edge = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edge[::2].tolist(), edge[1::2].tolist(), strict=True))


EXPERIMENTS: Mapping[str, Callable[[argparse.Namespace], None]] = {
    "integration": print_integration,
    "preintegration": print_preintegration,
    "gaps": print_gaps,
    "peaks": print_peaks,
}

if __name__ == "__main__":
    harness.run(main)
