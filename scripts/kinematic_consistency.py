"""Does the simulated foot agree with itself? What exact integration of noise-free samples leaves at a stride's end.

    python scripts/kinematic_consistency.py [--strides N] [--seed N] [--mount NAME]

A sample is the mean of rate and specific force over its period. Strapdown integration that is exact for constant rate
and force (`fg_nav.mechanisation`) starts from the true state at the beginning of each stride and is compared with the
true state at its end.

"plain" takes the samples as they are. What is left is the motion within a sample: with w, f and their rates of change,
a sample of period h misses the angle h^3/12 w x w' (coning) and the velocity h^3/12 (w x f' - w' x f) (sculling). That
is second order in the period: twice the rate leaves a quarter. It is physics of a foot, not an error of the simulator:
the same integral over the real gdin walks, at 400 Hz, is 0.2 to 0.8 mm/s a stride.
"corrected" has these two terms added, as every estimator here has them (`fg_nav.samples.coning`): what is still left is
of fourth order, and shows that samples and truth agree.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise

import figures as fig
import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.foot import FootMotion, foot_motion
from fg_nav.lab.simulation.footsteps import Strides, Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import MOUNTS, Person, mount_named
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, plan
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.samples.coning import compensated

RATES_HZ = (100.0, 200.0, 400.0, 800.0)
QUANTITIES = ("attitude, mdeg", "velocity, mm/s", "position, mm")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What exact integration of noise-free samples leaves of a stride.")
    parser.add_argument("--strides", type=int, default=200, metavar="N", help="of each style (200)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="draws strides and motion (1)")
    parser.add_argument("--mount", default="instep", help=f"{' or '.join(MOUNTS)}")
    chosen = parser.parse_args(arguments)
    if chosen.strides < 1:
        raise SimulationError(f"{chosen.strides} strides show nothing: ask for one or more.")
    fig.print_heading("Left over at the end of a stride: median (most)")
    table = [row for style in Style for row in rows(chosen, style)]
    fig.print_table(
        ("stride", "samples", "error", *(f"{rate:.0f} Hz" for rate in RATES_HZ), "ratios of medians"), table
    )


def rows(chosen: argparse.Namespace, style: Style) -> list[list[str]]:
    """One row a quantity and way of integration."""
    rng = np.random.default_rng(chosen.seed)
    person = Person()
    strides = plan([Stand(1.0), section(style, chosen.strides, person)], person, rng)
    motion = foot_motion(strides, person, mount_named(chosen.mount), rng)
    name = style.name.lower().replace("_", " ")
    return [
        [name, "corrected" if corrected else "plain", *row]
        for corrected in (False, True)
        for row in _rows([np.linalg.norm(left_over(motion, strides, rate, corrected), axis=2) for rate in RATES_HZ])
    ]


def _rows(sizes: Sequence[Floats]) -> list[list[str]]:
    medians, most = (np.array([pick(size, axis=0) for size in sizes]) for pick in (np.median, np.max))
    ratios = [[f"{a / b:.1f}" for a, b in pairwise(column)] for column in medians.T]
    return [
        [name, *(f"{m:.3f} ({x:.3f})" for m, x in zip(medians[:, i], most[:, i], strict=True)), " ".join(ratios[i])]
        for i, name in enumerate(QUANTITIES)
    ]


def section(style: Style, count: int, person: Person) -> Section:
    """About `count` strides of a style."""
    if style in (Style.WALK, Style.RUN):
        return Walk(straight(person.gait(style).stride_m * count), style)
    if style is Style.TURN:
        return TurnOnSpot(np.pi / 4 * count)
    return Stairs(2 * count, up=style is Style.STAIRS_UP)


def left_over(motion: FootMotion, strides: Strides, rate_hz: float, corrected: bool = False) -> Floats:
    """Error (K, 3, 3) at the end of each stride: of attitude, mdeg; of velocity, mm/s; of position, mm."""
    first = np.ceil(strides.start * rate_hz)
    last = np.floor((strides.start + strides.duration) * rate_hz)
    spans = (np.arange(i, j + 1) / rate_hz for i, j in zip(first, last, strict=True))
    return np.array([_left_over(motion, t, 1 / rate_hz, corrected) for t in spans])


def _left_over(motion: FootMotion, t: Floats, period_s: float, corrected: bool) -> Floats:
    rate, force = motion.sampled(t[:-1], period_s)
    if corrected:
        force, rate = compensated(force, rate, np.full(len(rate), period_s))
    ends = motion.at(t[[0, -1]])
    state = NavState(ends.position[0], ends.velocity[0], ends.nav_R_body[0], np.zeros(3), np.zeros(3))
    integrate(state, force, rate, period_s)
    turned = state.nav_R_body.T @ ends.nav_R_body[1]
    turn = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    return 1e3 * np.stack([np.rad2deg(turn), state.velocity - ends.velocity[1], state.position - ends.position[1]])


@njit
def integrate(state: NavState, force: Floats, rate: Floats, period_s: float) -> None:
    """Move `state` over samples (N, 3) of specific force and rate."""
    turn, push = np.empty((3, 3)), np.empty(3)
    for n in range(len(rate)):
        strapdown(state, force[n], rate[n], period_s, GRAVITY_M_S2, turn, push)


if __name__ == "__main__":
    fig.leave_with(main)
