"""Short random walks with everything that can go wrong, pushed through the online navigator.

    python scripts/online_fuzz.py [--seeds N] [--first SEED] [--lag SECONDS] [--show]

Each seed draws a person, a sensor, a course of four to eight parts (walking at some pace, running, standing, turning on
the spot, stairs) and a field, and then defects, each on about a third of the walks:

=========== ===========================================================================================
gap         0.05 to 5 s without a sample
burst       0.02 to 3 s of NaN in acc, gyr or both
single      single samples missing all over
clipped     gyroscope and accelerometer clip at 250 to 600 deg/s and 30 to 80 m/s^2
magnet      a magnet of up to 300 uT at the sensor passes by within 0.3 to 3 s
no field    stretches without a sample of the magnetometer, or no magnetometer at all
stamps      repeated, backward, far ahead, or the clock begins again
cut         the recording begins in the middle of the walk
=========== ===========================================================================================

It comes in blocks of one sample to two seconds; heading given or not, field used or not; the walk is then solved as a
whole. Asked: no exception, nothing but numbers in what is reported, and sigmas that grow where the input is lost for a
second or more. Reported too: how far the end is off over its own sigma.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import harness
import numpy as np
from fuzz_mutations import SAMPLE_MUTATIONS
from harness import FIRST_SEED, Figure, option

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation import Choices, Scenario, simulate
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import Pose, arc, straight
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, end_of
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.recording import Recording
from fg_nav.samples.intake import Intake
from fg_nav.solution import StanceTable
from fg_nav.truth import TrajectoryTruth

LOST_S = 1.0  # A loss of input that must show in the sigmas.

RATES_HZ = (100.0, 200.0)
SENSORS = ("demo", "mpu-9250x8", "lord-gx5")
GROWTH_M_S = 0.05
"""By so much for each second of a loss the sigma of the height grows, m in quadrature: a foot swings 0.1 to 0.3 m high.
Over the ground a sigma may shrink instead, where north becomes known."""

MAX_OFF = 3.0  # Of the ends behind a loss 95 % are nearer, in sigmas; 1.7 by right.
FAR_SIGMAS = 5.0  # An end this far off is named.


@dataclass
class Fate:
    """What became of a walk."""

    seed: int
    defects: tuple[str, ...]
    footfalls: int = 0
    lost_s: float = 0.0
    grew: bool | None = None
    not_finite: bool = False
    failed: str = ""
    off_sigmas: float = float("nan")
    notes: list[str] = field(default_factory=list)


def draw_course(rng: np.random.Generator, parts: int | None = None) -> list[Section]:
    """Draw so many parts, or four to eight, one behind the other."""
    sections: list[Section] = []
    pose = Pose(np.zeros(3), 0.0)
    if rng.random() < 0.8:
        sections.append(Stand(rng.uniform(0.5, 4.0)))
    for _ in range(rng.integers(3, 8) if parts is None else parts):
        section = _draw_part(rng, pose)
        sections.append(section)
        pose = end_of(section, pose)
    if rng.random() < 0.8:
        sections.append(Stand(rng.uniform(0.5, 3.0)))
    return sections


def _draw_part(rng: np.random.Generator, pose: Pose) -> Section:
    kind = rng.choice(["walk", "walk", "walk", "run", "stand", "turn", "stairs"])
    if kind == "stand":
        return Stand(rng.uniform(0.5, 8.0))
    if kind == "turn":
        return TurnOnSpot(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 3.1))
    if kind == "stairs":
        return Stairs(int(rng.integers(4, 12)), up=bool(rng.random() < 0.5))
    path = (
        straight(rng.uniform(4.0, 12.0)) if rng.random() < 0.5 else arc(rng.uniform(2.0, 6.0), rng.uniform(-2.0, 2.0))
    )
    if kind == "run":
        return Walk(path.place(pose), Style.RUN)
    return Walk(path.place(pose), Style.WALK, pace=rng.uniform(0.5, 1.3))


def draw_walk(seed: int, rng: np.random.Generator) -> Recording:
    """Simulate a short walk."""
    scenario = Scenario(
        f"fuzz {seed}", "", draw_course, "instep" if rng.random() < 0.7 else "heel", str(rng.choice(SENSORS)),
        field=str(rng.choice(["smooth", "indoor"])),
    )  # fmt: skip
    rate = float(rng.choice(RATES_HZ))
    return simulate(scenario, seed, Choices(rate_hz=rate, calibrated=bool(rng.random() < 0.5))).recording


def spoil(recording: Recording, rng: np.random.Generator) -> tuple[Floats, tuple[str, ...]]:
    """Return rows (n, 10) of t, acc, gyr, mag with defects, and which ones."""
    mag = np.full((len(recording), 3), np.nan) if recording.mag is None else recording.mag
    rows = np.column_stack([recording.t, recording.acc, recording.gyr, mag])
    chosen = [name for name in DEFECTS if rng.random() < 0.33]
    for name in chosen:
        rows = DEFECTS[name](rows, rng)
    return rows, tuple(chosen)


NAMES = ("clipped", "magnet", "no field", "gap", "burst", "single", "cut", "stamps")
DEFECTS = {name: SAMPLE_MUTATIONS[name] for name in NAMES}  # What can go wrong with samples, in this order.


def blocks(rows: Floats, rng: np.random.Generator) -> Iterator[Floats]:
    """Cut rows into blocks of one sample to some two seconds."""
    start, longest = 0, int(rng.choice([1, 10, 100, 400]))
    while start < len(rows):
        stop = start + int(rng.integers(1, longest + 1))
        yield rows[start:stop]
        start = stop


def push_walk(seed: int, lag_s: float | None) -> Fate:
    """Draw a walk and push it through."""
    rng = np.random.default_rng(seed)
    recording = draw_walk(seed, rng)
    rows, defects = spoil(recording, rng)
    known_heading = bool(rng.random() < 0.5)
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading = float(compute_heading(truth.nav_R_body[np.searchsorted(truth.t, rows[0, 0])])) if known_heading else None
    fate = Fate(seed, defects)
    try:
        options = OnlineOptions(heading_rad=heading, use_field=bool(rng.random() < 0.7), lag_s=lag_s)
        navigator = OnlineNavigator(options)
        for block in blocks(rows, rng):
            navigator.push(block[:, 0], block[:, 1:4], block[:, 4:7], block[:, 7:10])
        navigator.close()
        taken = Intake().push(np.column_stack([rows, np.full(len(rows), np.nan)]))
        _judge(fate, navigator, taken[:, 0], truth if known_heading and "stamps" not in defects else None)
    except Exception:
        fate.failed = traceback.format_exc()
    return fate


def _judge(fate: Fate, navigator: OnlineNavigator, stamps: Floats, truth: TrajectoryTruth | None) -> None:
    fate.footfalls = len(navigator.footfalls)
    if fate.footfalls == 0:
        return
    causal, smoothed = navigator.causal(), navigator.smoothed()
    fate.not_finite = not (_finite(causal) and _finite(smoothed))
    if fate.footfalls > 1:
        solution = navigator.finish()
        fate.not_finite |= not (_finite(solution.stances) and bool(np.isfinite(solution.position).all()))
    _growth(fate, causal, stamps)
    if truth is not None:
        fate.off_sigmas = _off(causal, truth)
        if fate.off_sigmas > FAR_SIGMAS:
            fate.notes.append(f"the end is {fate.off_sigmas:.1f} sigmas off")


def _finite(table: StanceTable) -> bool:
    numbers = (table.position, table.nav_R_body, table.gyro_bias, table.position_cov, table.heading_sigma)
    return all(bool(np.isfinite(part).all()) for part in numbers)


def _growth(fate: Fate, table: StanceTable, stamps: Floats) -> None:
    """Whether the sigma of the height is larger behind the longest loss than before it."""
    step = np.diff(stamps)
    k = int(np.argmax(step))
    fate.lost_s = float(step[k])
    before, behind = (table.t <= stamps[k]), (table.t >= stamps[k + 1])
    if fate.lost_s < LOST_S or not before.any() or not behind.any():
        return
    sigma = table.position_sigma[:, 2]
    ahead, after = float(sigma[before][-1]), float(sigma[behind][0])
    fate.grew = after**2 - ahead**2 > (GROWTH_M_S * fate.lost_s) ** 2
    if not fate.grew:
        fate.notes.append(f"sigma {ahead:.3f} m before and {after:.3f} m after {fate.lost_s:.1f} s")


def _off(table: StanceTable, truth: TrajectoryTruth) -> float:
    """Return how far the last footfall is off, over the ground, in its own sigmas (Mahalanobis)."""
    true = np.array([np.interp(table.t[[0, -1]], truth.t, axis) for axis in truth.position.T]).T
    assert truth.nav_R_body is not None
    first = int(np.searchsorted(truth.t, table.t[0]))
    turn = float(compute_heading(truth.nav_R_body[first]) - compute_heading(table.nav_R_body[0]))
    way = yaw_rotation(-turn) @ (table.position[-1] - table.position[0])
    error = (way - (true[1] - true[0]))[:2]
    covariance = table.position_cov[-1][:2, :2]
    return float(np.sqrt(error @ np.linalg.solve(covariance, error) / 2))


def judge_all(fates: Sequence[Fate]) -> list[Figure]:
    """Figures of all walks."""
    lost = [fate for fate in fates if fate.grew is not None]
    off = np.array([fate.off_sigmas for fate in fates if np.isfinite(fate.off_sigmas)])
    off_lost = np.array([fate.off_sigmas for fate in lost if np.isfinite(fate.off_sigmas)])

    def figure(name: str, value: float, low: float = -np.inf, high: float = np.inf, pattern: str = "{:.0f}") -> Figure:
        return Figure("fuzz", name, "online", float(value), low, high, pattern)

    found = [
        figure("walks", len(fates)),
        figure("footfalls", sum(fate.footfalls for fate in fates)),
        figure("walks without a footfall", sum(fate.footfalls == 0 for fate in fates)),
        figure("exceptions", sum(bool(fate.failed) for fate in fates), high=0),
        figure("walks with a number that is none", sum(fate.not_finite for fate in fates), high=0),
        figure(f"walks that lost {LOST_S:g} s or more", len(lost)),
        figure("of them with sigmas that did not grow", sum(not fate.grew for fate in lost), high=0),
    ]
    for name, values, most in (("end off, sigmas: ", off, np.inf), ("after a loss: ", off_lost, MAX_OFF)):
        if len(values):
            found.append(figure(name + "median", np.median(values), pattern="{:.2f}"))
            found.append(figure(name + "95 %", np.quantile(values, 0.95), high=most, pattern="{:.2f}"))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=20,
        first=FIRST_SEED,
        jobs=1,
        lag=option(None, "fixed lag", type=float, metavar="SECONDS"),
        show=option(False, "each walk that failed, with its traceback"),
    )
    fates = harness.map_walks(partial(push_walk, lag_s=given.lag), harness.seeds_of(given), given.jobs, "fuzz")
    harness.print_heading(f"{given.seeds} random walks from seed {given.first} on")
    for fate in fates:
        words = fate.failed.strip().splitlines()[-1:] + ["not finite"] * fate.not_finite + fate.notes
        if words:
            print(f"seed {fate.seed} ({', '.join(fate.defects)}): {'; '.join(words)}")
        if given.show and fate.failed:
            print(fate.failed)
    found = judge_all(fates)
    harness.print_figures(found)
    harness.print_verdict(found)


if __name__ == "__main__":
    harness.run(main)
