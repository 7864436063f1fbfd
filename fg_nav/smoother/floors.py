"""Level floors where a walk shows them; ramps, stairs and what it does not show are left alone.

Between footfalls of one foot the first solution moves by d = (dx, dy) over ground and climbs by

    dz = c q + m + noise,  m = 0           on a level floor
                               n r         on stairs of risers r, one or two at a stride, up or down
                               g . d       on a plane of gradient g: a ramp, climbed one way and descended the other
                               s |d|       on a way that climbs though it turns: a curved ramp
                               anything    on a step: heavy tails about zero

c is what strides of the walk climb in excess whatever their direction, with a Student prior (`settling_sigma_m`), q the
length of a stride over that of the usual one, r the riser of `RISERS_M` with the largest evidence, strides taken one by
one. With c and g on grids, and the ground passing into any other with probability `CHANGE`, by their shares, this is a
hidden Markov model (Rabiner 1989), which `docs/models.md` describes, with the limit that a common gradient sets.

A stretch of level strides in a row is on a floor that was left earlier if the strides between climbed by h = 0 +-
sigma, their noise and that of their c, against being on any other level within `LEVELS_WITHIN_M`, by `MAX_NATS`:

    log N(h; 0, sigma^2) + log(2 LEVELS_WITHIN_M) > MAX_NATS.

Otherwise it is a floor of its own. The noise is that of the walk, by medians of differences of successive climbs and of
successive means of `BLOCK` strides, the larger of both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, find_runs, weigh_models
from fg_nav.smoother.sensitivity import MAX_NATS
from fg_nav.smoother.strides import SETTLING_TIME_S
from fg_nav.system.compiled import njit

CHANGE = 1.0 / 30.0  # Probability that the ground changes from a stride to the next: each 40 m.
DRIFTS_M = np.arange(-80.0, 80.1, 1.0) * 1e-3  # Grid of c, m a stride: a walk shows it to a millimetre.
DRIFT_TAILS = 2.0  # Degrees of freedom of its prior: one sensor in fifty is worse by six sigmas.
RISERS_M = np.arange(0.135, 0.2201, 0.005)  # Of stairs, indoors 0.15 to 0.19.
FLIGHT = np.array([1.0, 2.0, -1.0, -2.0])  # Risers that a foot climbs at a stride.
MIN_STRIDE_M = 0.25  # Over ground; on stairs a stride is half a metre.
LENGTHS = (0.5, 1.5)  # Between which the length q of a stride counts: a landing is twice as long as a stair.
PILOT, PILOT_NATS = 400, 15.0  # Strides after which values of c so much less probable are left out: for speed.
LATTICE_NOISES_M = np.array([0.007, 0.012, 0.02, 0.035])  # Noise of a climb that are tried where the riser is found.
LATTICE_STEP = 2  # Of the grid of c, there.
SLOPES = np.array([0.003, 0.006, 0.012, 0.025, 0.05, 0.1])  # Gradients, from below what is noticed to a steep ramp.
NOTICED_M = 0.05  # What a slope climbs by over the width of the whole walk for it to matter.
DIRECTIONS = 12  # Of a plane's gradient.
SHARES = np.array([0.84, 0.05, 0.05, 0.059, 0.001])  # Prior of level, steps, stairs, planes, curved ramps.
LEVEL_ODDS = float(np.exp(MAX_NATS))
STEP_SCALE_M = 0.3  # Half of all steps climb by less: a riser is 0.15 to 0.19 m, and a foot climbs two at a time.
OUTLIER_SHARE, OUTLIER_SCALE = 0.05, 3  # Strides with a worse height, by so much: the more, the later a kerb is one.
TILT_SIGMA, TILT_M = 0.005, 0.15  # Gradient of floors that drain; how much of height it may leave uncertain.
MIN_NOISE_M = 0.007  # Of the climb of a stride: floors are not more even.
BLOCK = 5  # Strides in whose mean the noise that is common to neighbors shows.
LEVELS_WITHIN_M = 10.0  # Of a floor lie the other levels that a walk may come to: three storeys.
FEWEST = 4  # Footfalls of a level stretch: a landing has two or three.
FORGOTTEN = 1e6  # Strides whose climbs leave no floor to be recognized: as many as an unseen one counts for.
LEVEL_SIGMA_M = 0.015  # Height of the sensor in a stance above its floor: mats, thresholds, how the foot is set.


@dataclass(frozen=True)
class Ground:
    """Probability `level` (K,) of each stride; c as `drift` and `drift_sigma`, and the `noise` of a stride, m."""

    level: Floats
    drift: float
    drift_sigma: float
    noise: float


def find_floors(
    t: Floats, position: Floats, settling_sigma_m: float, unseen: Bools | None = None
) -> tuple[Ints, Ground | None]:
    """Return the floor (F,) of footfalls, 0, 1, ... as they are met, -1 on none; and the ground under the strides.

    Footfalls at `t` (F,) s and `position` (F, 3) m. `settling_sigma_m` is that of the excess S, from which c has its
    prior; `unseen` (F-1,) are the strides in which samples are missing, after which no floor is recognized. No ground
    where there are too few footfalls.
    """
    if len(position) < FEWEST:
        return np.full(len(position), -1, dtype=np.intp), None
    step = np.diff(position, axis=0)
    drift_sigma_m = settling_sigma_m / SETTLING_TIME_S * float(np.median(np.diff(t)))
    ground = judge_ground(step, drift_sigma_m)
    level = ground.level > LEVEL_ODDS / (1.0 + LEVEL_ODDS)
    # No floor is level where a gradient common to the level strides (L, 2) m leaves the height of a footfall unknown, c
    # being unknown as well.
    over_ground = step[level, :2]
    design = np.column_stack([np.ones(len(over_ground)), over_ground]) / ground.noise
    prior = np.diag(np.array([drift_sigma_m, TILT_SIGMA, TILT_SIGMA]) ** -2.0)
    gradient = np.linalg.inv(design.T @ design + prior)[1:, 1:]
    place = np.cumsum(over_ground, axis=0)
    tilt_sigma = float(np.einsum("ki,ij,kj->k", place, gradient, place).max(initial=0.0) ** 0.5)
    level &= tilt_sigma < TILT_M
    unseen = np.zeros(len(level), dtype=np.bool_) if unseen is None else unseen
    level &= ~unseen
    # Net climb between footfalls that no level stride joins.
    off = np.where(level, 0.0, np.where(unseen, FORGOTTEN, 1.0))
    strides = np.append(0.0, np.cumsum(off))
    height = np.append(0.0, np.cumsum(off * (step[:, 2] - ground.drift)))
    # Level strides in a row, by their first and last footfall, are on a floor that was left or on the next one.
    floor, left = np.full(len(position), -1, dtype=np.intp), list[int]()
    for first, last in zip(*(ends.tolist() for ends in find_runs(level)), strict=True):
        if last - first + 1 >= FEWEST:
            number = _recognize(first, left, strides, height, ground)
            floor[first : last + 1] = number
            left[number:] = [last, *left[number + 1 :]]
    return floor, ground


def judge_ground(step: Floats, drift_sigma_m: float) -> Ground:
    """Return P(level) of each stride, c and noise, by a hidden Markov model; `step` (K, 3) m, prior sigma of c in m."""
    # Steps on the spot are not counted: their climb is that of setting the foot down.
    length = np.hypot(*step.T[:2])
    strides = length > MIN_STRIDE_M
    q = np.clip(length / max(float(np.median(length[strides])) if strides.any() else 1.0, MIN_STRIDE_M), *LENGTHS)
    riser, noise = find_riser(step[strides, 2], q[strides], drift_sigma_m)
    # Climb (K, S) m on each ground: level, a step, stairs, planes, curved ramps; and the share (S,) of each before.
    width = np.linalg.norm(np.ptp(np.cumsum(step[:, :2], axis=0), axis=0))
    slopes = SLOPES[SLOPES * width > NOTICED_M]
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    gradients = (slopes[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    both_ways = np.concatenate([slopes, -slopes])
    on_planes = step[:, :2] @ gradients.T
    on_curves = np.linalg.norm(step[:, :2], axis=1)[:, None] * both_ways
    on_stairs = np.tile(FLIGHT * riser, (len(step), 1))
    counts = np.array([1, 1, len(FLIGHT), len(gradients), len(both_ways)])
    share = np.repeat(SHARES / np.maximum(counts, 1), counts)
    expected, share = np.hstack([np.zeros((len(step), 2)), on_stairs, on_planes, on_curves]), share / share.sum()
    # The values of c that the first strides leave, then both passes.
    climb = np.where(strides, step[:, 2], np.nan)
    drifts, log_prior = DRIFTS_M, _prior_of_drift(drift_sigma_m)
    if len(step) > PILOT:
        seen = _pass_forth(climb[:PILOT], expected[:PILOT], share, noise, drifts, q)[1]
        log_weight = np.log(seen).sum(axis=0) + log_prior
        kept = np.flatnonzero(log_weight > log_weight.max() - PILOT_NATS)
        drifts, log_prior = (one[max(kept[0] - 1, 0) : kept[-1] + 2] for one in (drifts, log_prior))
    level, total = _pass_forth(climb, expected, share, noise, drifts, q)
    level *= _pass_back(climb, expected, share, noise, total, drifts, q)
    weight = weigh_models(np.log(total).sum(axis=0) + log_prior)
    drift = float(weight @ drifts)
    return Ground(level @ weight, drift, float(np.sqrt(weight @ (drifts - drift) ** 2)), noise)


def _prior_of_drift(drift_sigma_m: float) -> Floats:
    """Logarithm of the prior (C,) of c, up to a constant."""
    return -0.5 * (DRIFT_TAILS + 1.0) * np.log1p((DRIFTS_M / drift_sigma_m) ** 2 / DRIFT_TAILS)


def find_riser(climb: Floats, length: Floats, drift_sigma_m: float) -> tuple[float, float]:
    """Return riser of the stairs and noise of a climb, m, of largest evidence, from climbs (K,) m.

    `length` (K,) is stride length over the usual one. Strides are independent here, a mixture of level ground, stairs
    and steps; at most `PILOT` of them, evenly over the walk. The noise is that of what climbs are off the lattice.
    """
    some = np.linspace(0, len(climb) - 1, min(len(climb), PILOT)).astype(int)
    drifts, prior = DRIFTS_M[::LATTICE_STEP], _prior_of_drift(drift_sigma_m)[::LATTICE_STEP]
    off = climb[some, None] - length[some, None] * drifts
    anything = SHARES[1] * STEP_SCALE_M / (np.pi * (STEP_SCALE_M**2 + off**2))
    best = (-np.inf, 0.0, 0.0, 0.0)
    for noise in LATTICE_NOISES_M:
        scale = 1.0 / (np.sqrt(2.0 * np.pi) * noise)
        others = anything + SHARES[0] * scale * np.exp(-0.5 * (off / noise) ** 2)
        for riser in RISERS_M:
            flights = sum(np.exp(-0.5 * ((off - n * riser) / noise) ** 2) for n in FLIGHT) / len(FLIGHT)
            log_of_drift = np.log(others + SHARES[2] * scale * flights).sum(axis=0) + prior
            evidence = float(np.logaddexp.reduce(log_of_drift))
            if evidence > best[0]:
                best = evidence, float(riser), float(noise), float(drifts[int(np.argmax(log_of_drift))])
    _, riser, noise, drift = best
    # Residual of each climb from the nearest multiple of the riser.
    lattice, left = np.append(0.0, FLIGHT * riser), climb - length * drift
    left = left - lattice[np.abs(left[:, None] - lattice).argmin(axis=1)]
    return riser, estimate_noise(left[np.abs(left) < 4.0 * noise])


@njit(cache=True)
def _pass_forth(
    climb: Floats, expected: Floats, share: Floats, noise: float, drift: Floats, length: Floats
) -> tuple[Floats, Floats]:
    """Forward pass: filtered P(level) (K, C) by stride and c, and likelihood (K, C) of each climb given the past."""
    count, drifts, grounds = len(climb), len(drift), len(share)
    level, total = np.empty((count, drifts)), np.empty((count, drifts))
    seen, likely = np.empty((grounds, drifts)), np.empty((grounds, drifts))
    for s in range(grounds):
        for c in range(drifts):
            seen[s, c] = share[s]
    for k in range(count):
        _write_likelihood(climb[k], expected[k], noise, length[k] * drift, likely)
        for c in range(drifts):
            total[k, c] = 0.0
        for s in range(grounds):
            for c in range(drifts):
                seen[s, c] = ((1.0 - CHANGE) * seen[s, c] + CHANGE * share[s]) * likely[s, c]
                total[k, c] += seen[s, c]
        for s in range(grounds):
            for c in range(drifts):
                seen[s, c] /= total[k, c]
        for c in range(drifts):
            level[k, c] = seen[0, c]
    return level, total


@njit(cache=True)
def _pass_back(
    climb: Floats, expected: Floats, share: Floats, noise: float, total: Floats, drift: Floats, length: Floats
) -> Floats:
    """Backward pass: factor (K, C) by which later strides change the filtered P(level) of each stride."""
    count, drifts, grounds = len(climb), len(drift), len(share)
    more, after, likely = np.empty((count, drifts)), np.ones((grounds, drifts)), np.empty((grounds, drifts))
    mean = np.empty(drifts)
    for k in range(count - 1, -1, -1):
        _write_likelihood(climb[k], expected[k], noise, length[k] * drift, likely)
        for c in range(drifts):
            more[k, c], mean[c] = after[0, c], 0.0
        for s in range(grounds):
            for c in range(drifts):
                after[s, c] *= likely[s, c] / total[k, c]
                mean[c] += after[s, c] * share[s]
        for s in range(grounds):
            for c in range(drifts):
                after[s, c] = (1.0 - CHANGE) * after[s, c] + CHANGE * mean[c]
    return more


@njit(cache=True)
def _write_likelihood(climb: float, expected: Floats, noise: float, drift: Floats, out: Floats) -> None:
    """Write the likelihood (S, C) 1/m of the climb of a stride on each ground and for each c.

    On a grid of step d a Gaussian goes from point to point by a factor that goes by exp(-d^2): so it is taken from the
    point next to its peak outward, where nothing overflows. The narrow one is wide^(`OUTLIER_SCALE`^2). A climb that is
    NaN fits every ground alike.
    """
    if np.isnan(climb):
        out[:] = 1.0
        return
    step, last = (drift[1] - drift[0]) / (OUTLIER_SCALE * noise), len(drift) - 1
    decay, scale = np.exp(-step * step), 1.0 / (np.sqrt(2.0 * np.pi) * noise)
    usual, outlying = (1.0 - OUTLIER_SHARE) * scale, OUTLIER_SHARE * scale / OUTLIER_SCALE
    for s in range(len(expected)):
        off = climb - expected[s]
        peak = min(max(int(np.rint((off - drift[0]) / (drift[1] - drift[0]))), 0), last)
        x = (off - drift[peak]) / (OUTLIER_SCALE * noise)
        for way in (1, -1):
            c, wide, fall = peak, np.exp(-0.5 * x * x), np.exp(way * x * step - 0.5 * step * step)
            while 0 <= c <= last:
                out[s, c] = usual * wide ** (OUTLIER_SCALE * OUTLIER_SCALE) + outlying * wide
                wide, fall, c = wide * fall, fall * decay, c + way
    of_step = STEP_SCALE_M / (np.pi * (STEP_SCALE_M**2 + climb**2))
    for c in range(last + 1):
        out[1, c] = of_step


def estimate_noise(climb: Floats) -> float:
    """Noise m of the climbs (K,) m of strides."""
    blocks = climb[: len(climb) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
    # Sigmas from differences of climbs, and of their means, by the median.
    each, together = (
        float(np.median(np.abs(np.diff(x))) / (0.6745 * np.sqrt(2.0))) if len(x) > 3 else 0.0 for x in (climb, blocks)
    )
    return max(each, float(BLOCK**0.5) * together, MIN_NOISE_M)


def _recognize(at: int, left: list[int], strides: Floats, height: Floats, ground: Ground) -> int:
    """Return the floor of footfall `at`: the number of that left at footfall `left[k]`, or a new one."""
    if not left:
        return 0
    between = strides[at] - strides[left]
    variance = 2 * LEVEL_SIGMA_M**2 + ground.noise**2 * between + (ground.drift_sigma * between) ** 2
    climbed = height[at] - height[left]
    nats = np.log(2.0 * LEVELS_WITHIN_M) - 0.5 * (climbed**2 / variance + np.log(2.0 * np.pi * variance))
    best = int(np.argmax(nats))
    return best if nats[best] > MAX_NATS else len(left)
