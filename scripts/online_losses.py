"""Walks that lose seconds: how far off the lines behind are, and what their sigmas say.

    python scripts/online_losses.py [--seeds N] [--first SEED] [--jobs N] [--lost SECONDS ...] [--unseeing]

Each seed draws a person, a sensor and a course, 25 s before and after a loss in mid-walk, and
for each loss cuts out that many seconds. A walk whose stamps begin again behind the loss (`restart`) has lost 10 s,
which nothing shows. The heading is given. What is told at the moment is compared with the truth:

=============== =================================================================================================
sigma           of the place over ground, both axes together, m: of the first line behind the loss, ten lines later,
                and of the last
error / sigma   how far that line is off over it: 1 by right, and below 2.4 in 95 % where the two axes are alike
heading         error in deg, and over its sigma
=============== =================================================================================================

With `--unseeing` the magnetometer is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import harness
import numpy as np
from harness import FIRST_SEED, option, spread

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading, wrap_angle, yaw_rotation
from fg_nav.lab.simulation import Choices, Scenario, simulate
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import Pose, arc, straight
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, end_of
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.recording import Recording
from fg_nav.solution import StanceTable
from fg_nav.truth import TrajectoryTruth

RATES_HZ, SENSORS = (100.0, 200.0), ("demo", "mpu-9250x8", "lord-gx5")

AROUND_S = 25.0  # Walked before a loss, and behind it.

BLOCK_S = 0.1

RESTART_S = 10.0  # Lost where the sensor starts again.

RESTART = "restart"

LATER = 10  # Lines behind the first.


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


@dataclass(frozen=True)
class Behind:
    """What a line behind a loss says, and by how much it is wrong."""

    error_m: float
    sigma_m: float
    turned_rad: float
    heading_sigma_rad: float


@dataclass(frozen=True)
class Fate:
    """A walk that lost some: the lines behind, as `WHICH`; none where the foot did not swing again."""

    lost: str
    lines: tuple[Behind, ...]


WHICH = ("first line", "ten later", "last line")


def draw_walk(seed: int, duration_s: float) -> Recording:
    """Simulate a walk of at least so long: a course of many parts."""
    rng = np.random.default_rng(seed)
    mount, sensor = ("instep" if rng.random() < 0.7 else "heel"), str(rng.choice(SENSORS))
    field, rate = str(rng.choice(["smooth", "indoor"])), float(rng.choice(RATES_HZ))

    for parts in count(int(duration_s / 6.0), int(duration_s / 12.0)):
        course = partial(draw_course, parts=parts)
        scenario = Scenario(f"losses {seed}", "", course, mount, sensor, field=field)
        recording = simulate(scenario, seed, Choices(rate_hz=rate, calibrated=True)).recording
        if recording.duration_s >= duration_s:
            return recording
    raise AssertionError


def lose(recording: Recording, lost: str, rng: np.random.Generator) -> tuple[Floats, Recording]:
    """Return stamps as the sensor gives them, and the recording without what is lost."""
    seconds = RESTART_S if lost == RESTART else float(lost)
    latest = recording.duration_s - seconds - AROUND_S
    at = recording.t[0] + rng.uniform(AROUND_S - 5.0, latest)
    first, stop = np.searchsorted(recording.t, [at - AROUND_S, at + seconds + AROUND_S])
    kept = np.arange(first, stop)
    kept = kept[(recording.t[kept] < at) | (recording.t[kept] >= at + seconds)]
    mag = None if recording.mag is None else recording.mag[kept]
    cut = replace(recording, t=recording.t[kept], acc=recording.acc[kept], gyr=recording.gyr[kept], mag=mag)
    sent = cut.t - np.where((cut.t >= at) & (lost == RESTART), cut.t[np.searchsorted(cut.t, at)], 0.0)
    return sent, cut


def walk_on(seed: int, losses: Sequence[str], unseeing: bool) -> list[Fate]:
    """Draw a walk and push it through with each loss."""
    longest = max(RESTART_S if lost == RESTART else float(lost) for lost in losses)
    recording = draw_walk(seed, longest + 2 * AROUND_S + 5.0)
    return [_walk_with(recording, lost, np.random.default_rng(seed), unseeing) for lost in losses]


def _walk_with(recording: Recording, lost: str, rng: np.random.Generator, unseeing: bool) -> Fate:
    sent, cut = lose(recording, lost, rng)
    truth = cut.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading = float(compute_heading(truth.nav_R_body[np.searchsorted(truth.t, cut.t[0])]))
    navigator = OnlineNavigator(OnlineOptions(heading_rad=heading, use_field=not unseeing))
    block = round(BLOCK_S / cut.period_s)
    mag = np.full_like(cut.acc, np.nan) if cut.mag is None else cut.mag
    for i in range(0, len(cut), block):
        part = slice(i, i + block)
        navigator.push(sent[part], cut.acc[part], cut.gyr[part], mag[part])
    navigator.close()
    table = navigator.causal()
    taken = navigator.buffer.between(0, navigator.buffer.stop)
    true_t = cut.t[_find_rows(cut, taken)]
    hole = int(np.argmax(np.diff(taken[:, 0])))
    behind = np.flatnonzero(table.sample > hole)
    if not len(behind):
        return Fate(lost, ())
    rows = (behind[0], min(behind[0] + LATER, behind[-1]), behind[-1])
    return Fate(lost, tuple(_compare(table, int(k), truth, true_t) for k in rows))


def _find_rows(cut: Recording, taken: Floats) -> np.ndarray:
    """Rows of a recording that were taken, by their samples: stamps may have been changed."""
    number = {row.tobytes(): i for i, row in enumerate(np.column_stack([cut.acc, cut.gyr]))}
    return np.array([number[row.tobytes()] for row in np.ascontiguousarray(taken[:, 1:7])])


def _compare(table: StanceTable, k: int, truth: TrajectoryTruth, true_t: Floats) -> Behind:
    """Compare a line with the truth, as seen from the first line."""
    assert truth.nav_R_body is not None
    t = true_t[table.sample[[0, k]]]
    place = np.array([np.interp(t, truth.t, axis) for axis in truth.position.T]).T
    attitude = truth.nav_R_body[np.searchsorted(truth.t, t).clip(max=len(truth.t) - 1)]
    turned = compute_heading(table.nav_R_body[[0, k]]) - compute_heading(attitude)
    way = yaw_rotation(float(turned[0])) @ (table.position[k] - table.position[0])
    error = np.linalg.norm((way - (place[1] - place[0]))[:2])
    sigma = np.linalg.norm(table.position_sigma[k, :2])
    off = float(wrap_angle(np.array(turned[1] - turned[0])))
    return Behind(float(error), float(sigma), off, float(table.heading_sigma[k]))


def print_fates(fates: Sequence[Fate]) -> None:
    """Print a table of each loss, of its three lines."""
    for lost in dict.fromkeys(fate.lost for fate in fates):
        some = [fate.lines for fate in fates if fate.lost == lost and fate.lines]
        words = f"restart behind {RESTART_S:g} s" if lost == RESTART else f"{lost} s lost"
        harness.print_heading(f"{words}, {len(some)} walks")
        rows = [_describe(name, [lines[k] for lines in some]) for k, name in enumerate(WHICH)]
        headers = ["", "error m", "sigma m", "error / sigma", "beyond 3", "heading deg", "its sigma", "over sigma"]
        harness.print_table(headers, rows)


def _describe(name: str, lines: Sequence[Behind]) -> list[str]:
    error, sigma, turned, heading = np.array([tuple(vars(line).values()) for line in lines]).T
    return [
        name,
        spread(error),
        spread(sigma),
        spread(error / sigma),
        f"{(error > 3 * sigma).sum():.0f}",
        spread(np.degrees(np.abs(turned))),
        spread(np.degrees(heading)),
        spread(np.abs(turned) / heading),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the tables."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=20,
        first=FIRST_SEED,
        jobs=1,
        lost=option(["1", "3", "10", "30", "120", RESTART], "seconds, or restart", nargs="+", metavar="SECONDS"),
        unseeing=option(False, "without the magnetometer"),
    )
    push = partial(walk_on, losses=given.lost, unseeing=given.unseeing)
    found = harness.map_walks(push, harness.seeds_of(given), given.jobs, "losses")
    print_fates([fate for fates in found for fate in fates])


if __name__ == "__main__":
    harness.run(main)
