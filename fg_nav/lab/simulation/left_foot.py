"""The strides of a left foot beside those of the right one (`plan`), of the same person on the same path.

While the right foot swings the left one stands on a *stop*, halfway along the right one's stride; in the middle of that
stride it leaves, for the next stop. With c(n) the body's center on its path after n strides of the right foot, t_k and
T_k the start and the duration of its stride k (from 0 on), and cv the gait's variation, stop k is

    at c(k + 1/2 + e_k),    left at t_k + (1/2 + e'_k) T_k,    e, e' ~ N(0, (cv / 2)^2).

A left stride so lasts the mean of two right ones, with the variance cv^2 / 2 + 2 (cv / 2)^2 = cv^2 of a right one; its
length likewise. Where a walk begins or ends with the feet together, the stop is there: the left foot makes a stride
less, and no half ones. On stairs it takes the treads that the right foot leaves out. In a turn on the spot it is half a
stride ahead of the right one, for which it makes an *opening* stride before the first and a *closing* one after the
last. Where the person stands for so long that both find time, the feet are beside each other.

The person's center wanders off its path (`plan`) with both feet, and each foot scatters about its place by itself. The
feet are a step width apart that is the person's own, 0.15 +- 0.025 m (Schulz 2012: 0.14 +- 0.03 of the leg's length at
the heels; feet point a little outward, so the insteps are farther apart). It varies from step to step by the scatter of
both feet and a step's share of the wander, 2.1 to 2.4 cm (Skiadopoulos et al. 2020: young adults 2.0 to 2.5 cm;
Almarwani et al. 2016: 2.4 +- 0.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.lab.simulation.motion import Strides, Style
from fg_nav.lab.simulation.path import GAP_M, KINK_RAD
from fg_nav.lab.simulation.person import Gait, Person, Scatter
from fg_nav.lab.simulation.plan import STEP_WIDTH_M, Leg, WalkPlan, place_foot

USUAL_WIDTH_M, WIDTH_SD_M = 0.15, 0.025  # Step widths of persons, mean and standard deviation.
RAREST = 2.0  # No one treads wider or narrower by more standard deviations.

_RANK = np.array([0, 1, 3, 4, 2])
"""By `Style`: of the styles at both ends of a stride it has the higher one, stairs before turns before running."""


@dataclass(frozen=True)
class _Stops:
    """Where the left foot stands, S stops in order.

    Attributes
    ----------
    position, heading : (S, 3) m and (S,) rad of the body's center that belongs to each.
    number : (S,) strides of the right foot until there, whole or not.
    arrives, leaves : (S,) s, when the stride to it ends and the one from it begins.
    style : (S,) of `Style`, of the right foot's stride.
    """

    position: Floats
    heading: Floats
    number: Floats
    arrives: Floats
    leaves: Floats
    style: Ints


def draw_step_width(rng: np.random.Generator) -> float:
    """Draw how far apart a person's feet tread, m."""
    return USUAL_WIDTH_M + WIDTH_SD_M * float(np.clip(rng.standard_normal(), -RAREST, RAREST))


def plan_left_foot(
    plan: WalkPlan, person: Person, step_width_m: float, rng: np.random.Generator, scatter: Scatter = Scatter()
) -> Strides:
    """Draw the strides of the left foot.

    Parameters
    ----------
    plan : of the walk, with the right foot's strides.
    person : whose gait it is.
    step_width_m : between the lines on which the feet tread.
    rng : source of the variability.
    scatter : how regular the walker is.
    """
    stops = _find_stops(plan, person, rng)
    moves = _differ(stops)
    stands = np.concatenate([[0], np.flatnonzero(moves) + 1])
    wander = np.interp(stops.number[stands], np.arange(len(plan.wander)), plan.wander)
    aside_m = wander - (step_width_m - STEP_WIDTH_M / 2)
    footprint, toe = place_foot(stops.position[stands], stops.heading[stands], aside_m, rng, scatter)
    start, end = stops.leaves[:-1][moves], stops.arrives[1:][moves]
    return Strides(start, end - start, footprint, toe, _choose_styles(stops)[moves], plan.strides.end_s)


def _find_stops(plan: WalkPlan, person: Person, rng: np.random.Generator) -> _Stops:
    """Those in the middle of right strides and those where the person stands, in the order of time."""
    parts = _stop_halfway(plan, person, rng), _stop_standing(plan)
    order = np.argsort(np.concatenate([np.arange(len(plan.strides)) + 0.5, parts[1].number]))
    joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in vars(parts[0])}
    return _Stops(**joined)


def _stop_halfway(plan: WalkPlan, person: Person, rng: np.random.Generator) -> _Stops:
    """One stop in each stride of the right foot."""
    strides, variation = plan.strides, np.array([gait.variation for gait in person.gaits])[plan.strides.style]
    numbers = [_find_halves(leg, person.gait(leg.style), rng) for leg in plan.legs]
    places = [leg.along(number) for leg, number in zip(plan.legs, numbers, strict=True)]
    first = np.cumsum([0, *(len(leg) for leg in plan.legs)])
    share = 0.5 + variation / 2 * np.clip(rng.standard_normal(len(strides)), -RAREST, RAREST)
    leaves = strides.start + share * strides.duration
    return _Stops(
        position=np.vstack([position for position, _ in places]),
        heading=np.concatenate([heading for _, heading in places]),
        number=np.concatenate([begun + number for begun, number in zip(first, numbers, strict=False)]),
        arrives=leaves,
        leaves=leaves,
        style=strides.style,
    )


def _find_halves(leg: Leg, gait: Gait, rng: np.random.Generator) -> Floats:
    """Numbers of strides (n,) of a leg at which the left foot stands: halfway, but where the feet are together."""
    number = np.arange(len(leg), dtype=np.float64) + 0.5
    if leg.style in (Style.WALK, Style.RUN):
        number += gait.variation / 2 * np.clip(rng.standard_normal(len(leg)), -RAREST, RAREST)
    if leg.halves[1]:
        number[-1] = len(leg)
    if leg.halves[0]:
        number[0] = 0.0
    return number


def _stop_standing(plan: WalkPlan) -> _Stops:
    """Before the first stride, after the last, and in each pause that is long enough for a closing and an opening."""
    strides = plan.strides
    half, end = strides.duration / 2, strides.start + strides.duration
    closed = np.concatenate([[0.0], np.minimum(end + half, strides.end_s)])
    opened = np.append(np.maximum(strides.start - half, 0.0), strides.end_s)
    stands = closed <= opened
    stands[[0, -1]] = True
    position, heading = plan.center
    number = np.flatnonzero(stands)
    return _Stops(
        position[number], heading[number], number.astype(np.float64), closed[number], opened[number],
        np.full(len(number), Style.WALK, dtype=np.int64),
    )  # fmt: skip


def _differ(stops: _Stops) -> Bools:
    """(S - 1,) True where the next stop is another place or direction."""
    moved = np.linalg.norm(np.diff(stops.position, axis=0), axis=1) > GAP_M
    return np.asarray(moved | (np.abs(np.diff(stops.heading)) > KINK_RAD))


def _choose_styles(stops: _Stops) -> Ints:
    """(S - 1,) of the strides from stop to stop."""
    here, there = stops.style[:-1], stops.style[1:]
    return np.asarray(np.where(_RANK[here] > _RANK[there], here, there))
