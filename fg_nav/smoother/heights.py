"""Heights of a walk: level floors where it shows them, and the pressure of the air where it was recorded.

Floors (`docs/models.md`). Between footfalls of one foot the first solution moves by d = (dx, dy) over ground and climbs

    dz = c q + m + noise,  m = 0           on a level floor
                               n r         on stairs of risers r, one or two at a stride, up or down
                               g . d       on a plane of gradient g: a ramp, climbed one way and descended the other
                               s |d|       on a way that climbs though it turns: a curved ramp
                               anything    on a step: heavy tails about zero

c is what strides of the walk climb in excess whatever their direction, with a Student prior (`settling_sigma_m`), q the
length of a stride over that of the usual one, r the riser of `RISERS_M` with the largest evidence. With c and g on
grids, and the ground passing into any other with probability `CHANGE`, this is a hidden Markov model (Rabiner 1989).

A stretch of level strides is on a floor that was left earlier if the strides between climbed by h = 0 +- sigma, against
any other level within `LEVELS_WITHIN_M`: log N(h; 0, sigma^2) + log(2 LEVELS_WITHIN_M) > MAX_NATS. Floors have their
height Z as a variable (`factors.FloorHeight`): factors from footfall to footfall would sum up to a walk of their own.

Barometer (`docs/models.md`; residuals in `factors.walk_constraints`).

    p_k     mean pressure about the stillest sample of footfall k, within its stance and `REACH_S`, Pa
    h_k     R T_0 / (g M) log(p_0 / p_k), m above the first footfall with a reading, T_0 = 15 degC

Noise of p_k, with n_k the readings of footfall k, n the median, and run the footfalls that one quantum lasts,

    sigma^2 = (noise^2 + `AIR_PA`^2) min(1, n / n_k) + run quantum^2 / 12.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import P, S, X, Z

from fg_nav.arrays import Bools, Floats, Ints, find_runs, weigh_models
from fg_nav.detection.stance import Stances
from fg_nav.factors.residual import ResidualBlock, factor_of, one_of
from fg_nav.factors.walk_constraints import BarometerDrift, BarometricHeight, FloorHeight
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.graph import BAROMETER, WalkProblem
from fg_nav.smoother.sensitivity import SharingFactors, shared_information
from fg_nav.smoother.solver import BlockGroup, GtsamFactors, LinearizableBlock, Solved, list_positions
from fg_nav.smoother.strides import SETTLING_TIME_S, Nodes
from fg_nav.system.compiled import njit
from fg_nav.text import format_count

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
MAX_NATS = 3.0  # Twenty to one: what counts as strong evidence (Kass and Raftery 1995).
LEVEL_ODDS = float(np.exp(MAX_NATS))
STEP_SCALE_M = 0.3  # Half of all steps climb by less: a riser is 0.15 to 0.19 m, and a foot climbs two at a time.
OUTLIER_SHARE, OUTLIER_SCALE = 0.05, 3  # Strides with a worse height, by so much: the more, the later a kerb is one.
TILT_SIGMA, TILT_M = 0.005, 0.15  # Gradient of floors that drain; how much of height it may leave uncertain.
MIN_NOISE_M = 0.007  # Of the climb of a stride: floors are not more even.
BLOCK = 5  # Strides in whose mean the noise that is common to neighbors shows.
LEVELS_WITHIN_M = 10.0  # Of a floor lie the other levels that a walk may come to: three storeys.
FEWEST = 4  # Footfalls of a level stretch: a landing has two or three.
FORGOTTEN = 1e6  # Strides whose climbs leave no floor to be recognized: as many as an unseen one counts for.
DRIFT_FLOOR_M = 0.003  # What a walk shows of its climb a stride is no truer: on stairs it is another than on the level.
LEVEL_SIGMA_M = 0.015  # Height of the sensor in a stance above its floor: mats, thresholds, how the foot is set.
TEMPERATURE_K = 288.15  # Of the standard atmosphere near the ground.
SCALE_HEIGHT_M = 8.314463 * TEMPERATURE_K / (0.0289652 * GRAVITY_M_S2)  # R T_0 / (g M) of dry air: 8435 m.
SCALE_SIGMA = 15.0 / TEMPERATURE_K  # 0 to 30 degC.
DRIFT_PA = 0.6  # Random walk of the offset, Pa/sqrt(s): doors, ventilation, and a sensor that warms on a shoe.
TENDENCY_PA_S = 100.0 / 10800.0  # Sigma of the weather's tendency, and in three hours it is another.
AIR_PA = 1.0  # Stagnation pressure of the air that walking at 1.3 m/s moves about a shoe.
OFFSET_SIGMA_M = 100.0  # Before the first reading: it is free.
REACH_S = 2.0  # On either side of the stillest sample: a longer standing shows the drift.
MIN_READINGS = 4  # In a stance, for its halves to show noise.
MIN_STANCES = 5  # With as many readings, else differences at the barometer's rate show the noise.
MIN_QUANTUM_PA = 1e-2  # Smaller steps between readings are those of a unit's conversion.


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

    `settling_sigma_m` is that of the excess S, from which c has its prior; after strides that were `unseen` (F-1,) no
    floor is recognized. No ground where there are too few footfalls.
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
    # Level strides in a row are on a floor that was left, at footfall `left[number]`, if its height is so much more
    # probable than any other; else on a new one.
    floor, left = np.full(len(position), -1, dtype=np.intp), list[int]()
    for first, last in zip(*(ends.tolist() for ends in find_runs(level)), strict=True):
        if last - first + 1 < FEWEST:
            continue
        between, climbed = strides[first] - strides[left], height[first] - height[left]
        variance = 2 * LEVEL_SIGMA_M**2 + ground.noise**2 * between + (ground.drift_sigma * between) ** 2
        nats = np.log(2.0 * LEVELS_WITHIN_M) - 0.5 * (climbed**2 / variance + np.log(2.0 * np.pi * variance))
        number = int(np.argmax(nats)) if nats.max(initial=-np.inf) > MAX_NATS else len(left)
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
    """Return riser and noise of a climb, m, of largest evidence, from climbs (K,) m of strides of a `length` q (K,)."""
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


def add_constraints(problem: WalkProblem, values: gtsam.Values, continues: Bools | None = None) -> WalkProblem:
    """Return the problem with level floors and the soles' climb from a first solution; floor heights join `values`.

    `continues` (F,): footfalls that continue the standing of the one before, without a stride between.
    """
    p, nodes = problem.parameters, problem.nodes
    if not p.walk.floors:
        return problem
    position = list_positions(nodes.result, values)
    t, footfall = problem.recording.t, nodes.sample[nodes.result]
    stepped = np.ones(len(footfall), dtype=np.bool_) if continues is None else ~continues
    floor, ground = find_floors_of_pieces(t, footfall, position, stepped, p.settling_sigma_m)
    for number in range(floor.max(initial=-1) + 1):
        values.insert(Z(number), np.array([position[floor == number, 2].mean()]))
    heights = constrain_heights(nodes.result, floor, LEVEL_SIGMA_M)
    problem = replace(problem.join(heights), floor=floor)
    # What the ground shows of the excess S of the soles: S lifts each stride by S (duration of the stride) / (time in
    # which the sole settles). What the path climbs is beyond the S that it has at these values.
    ties, stride_s = problem.velocities.residuals, np.diff(t[footfall])[stepped[1:]]
    assert isinstance(ties, StanceVelocity)
    sinks_per_m = ties.sinks_per_m[ties.sinks_per_m > 0.0]
    if ground is None or not len(sinks_per_m) or not len(stride_s):
        return problem
    lift = float(np.median(sinks_per_m) * np.median(stride_s))
    noise = gtsam.noiseModel.Isotropic.Sigma(1, float(np.hypot(ground.drift_sigma, DRIFT_FLOOR_M) / lift))
    middle = S(int(nodes.bias[-1]) // 2)
    climb = GtsamFactors(gtsam.PriorFactorVector(middle, values.atVector(middle) + ground.drift / lift, noise))
    return problem.join(climb)


def find_floors_of_pieces(
    t: Floats, footfall: Ints, position: Floats, stepped: Bools, settling_sigma_m: float
) -> tuple[Ints, Ground | None]:
    """Return floors and ground as `find_floors`; pieces of a standing, not `stepped` (F,), share a floor."""
    first = np.flatnonzero(stepped | (np.arange(len(stepped)) == 0))
    holes = cross_holes(t, footfall[first])
    found, ground = find_floors(t[footfall[first]], position[first], settling_sigma_m, holes)
    return found[np.searchsorted(first, np.arange(len(stepped)), side="right") - 1], ground


def constrain_heights(node: Ints, label: Ints, sigma_m: float) -> ResidualBlock:
    """Keep footfalls at `node` (F,) at the heights of their floors `label` (F,), -1 on none."""
    on_floor = np.flatnonzero(label >= 0)
    return ResidualBlock(FloorHeight(sigma_m), [(X(int(node[k])), Z(int(label[k]))) for k in on_floor])


@dataclass(frozen=True)
class Barometer:
    """The pressure from which heights count, and what is known of the noise of a footfall's, Pa."""

    reference_pa: float  # p_0.
    white_pa: float  # Of the mean over `readings` of a stance.
    common_pa: float  # Of any mean.
    readings: float

    @property
    def m_per_pa(self) -> float:
        """Height by which the pressure falls by a pascal, m."""
        return SCALE_HEIGHT_M / self.reference_pa

    def sigma_m(self, count: Floats) -> Floats:
        """Return the sigma (K,) m of a height averaged over `count` (K,) readings."""
        averaged = np.minimum(1.0, self.readings / np.maximum(count, 1.0))
        return np.asarray(self.m_per_pa * np.sqrt(self.white_pa**2 * averaged + self.common_pa**2))

    def heights(self, seen: StancePressures, k: Ints) -> BarometricHeight:
        """Return barometric height (K, 1) m and sigma of footfalls `k` (K,), above the reference pressure."""
        height = SCALE_HEIGHT_M * np.log(self.reference_pa / seen.mean[k])
        return BarometricHeight(height[:, None], self.sigma_m(seen.number[k])[:, None])

    def drift(self, elapsed_s: Floats) -> BarometerDrift:
        """Return the random-walk factor of offset and tendency over intervals `elapsed_s` (K,)."""
        tendency = self.m_per_pa * TENDENCY_PA_S
        rates = self.m_per_pa * DRIFT_PA, tendency / np.sqrt(10800.0)
        return BarometerDrift(elapsed_s[:, None], np.sqrt(elapsed_s)[:, None] * rates)

    def prior(self, key: int, offset: float = 0.0) -> gtsam.PriorFactorVector:
        """Return the prior on the first state: a practically free offset about `offset` m, zero tendency."""
        sigmas = np.array([OFFSET_SIGMA_M, self.m_per_pa * TENDENCY_PA_S])
        return gtsam.PriorFactorVector(key, np.array([offset, 0.0]), gtsam.noiseModel.Diagonal.Sigmas(sigmas))


class StancePressures(NamedTuple):
    """Pressures about the stillest sample of each footfall."""

    mean: Floats  # (F,) Pa; NaN without a reading.
    halves: Floats  # (F,) Pa by which the means of the halves of its readings differ.
    number: Floats  # (F,) of readings.


def average_pressures(recording: Recording, stances: Stances, nodes: Nodes) -> StancePressures:
    """Average the pressure of each footfall over its stance, and over both halves of the readings for the noise."""
    # Samples with a reading; `first`, `last` those of each footfall: within the stance, `REACH_S` of the stillest.
    pressure = np.empty(0) if recording.pressure is None else recording.pressure
    at = np.flatnonzero(np.isfinite(pressure))
    readings = pressure[at]
    sample, interval = nodes.sample[nodes.result], nodes.interval[nodes.result]
    near = np.searchsorted(recording.t, recording.t[sample] + [[-REACH_S], [REACH_S]])
    first = np.searchsorted(at, np.maximum(near[0], stances.start[interval]))
    last = np.searchsorted(at, np.minimum(near[1], stances.stop[interval]))
    # Means of all and of both halves, by cumulative sums about the median: without it they lose digits.
    base = float(np.median(readings)) if len(readings) else 0.0
    total, middle = np.append(0.0, np.cumsum(readings - base)), (first + last) // 2
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, early, late = (
            (total[stop] - total[start]) / (stop - start)
            for start, stop in ((first, last), (first, middle), (middle, last))
        )
    return StancePressures(base + mean, late - early, (last - first).astype(np.float64))


def calibrate_barometer(recording: Recording, seen: StancePressures) -> Barometer | None:
    """Estimate reference pressure and noise of a walk's barometer; None without readings, or if it is stuck."""
    mean = seen.mean[np.isfinite(seen.mean)]
    if recording.pressure is None or not len(mean):
        return None
    # White noise of a stance's mean: from its halves, else from second differences (variance 6 sigma^2); MAD to sigma.
    readings = recording.pressure[np.isfinite(recording.pressure)]
    halves = np.abs(seen.halves[seen.number >= MIN_READINGS])
    if len(halves) >= MIN_STANCES:
        noise = 0.5 * float(np.median(halves)) / 0.6745
    else:
        second = np.abs(np.diff(readings, 2))
        noise = float(np.median(second)) / (0.6745 * np.sqrt(6.0)) if len(second) else 0.0
    # Resolution, and the run of footfalls with one reading, whose rounding error is common to all of them.
    steps = np.abs(np.diff(readings))
    if not steps.any():
        return None  # it is stuck, or its steps are too large to be known
    quantum = float(steps[steps > MIN_QUANTUM_PA].min(initial=np.inf))
    quantum = 0.0 if np.isinf(quantum) else quantum
    run = len(mean) / (1.0 + np.count_nonzero(np.abs(np.diff(mean)) > MIN_QUANTUM_PA))
    common = float(np.sqrt(run * quantum**2 / 12.0))
    count = float(np.median(seen.number[seen.number > 0]))
    return Barometer(float(mean[0]), float(np.hypot(noise, AIR_PA)), common, count)


class BarometerFactors(BlockGroup):
    """Factors of the barometer of a walk: `readings`, drift and the prior on the first state."""

    def __init__(self, barometer: Barometer, readings: ResidualBlock, *further: LinearizableBlock) -> None:
        super().__init__(readings, *further)
        self.barometer, self.readings = barometer, readings


def add_barometer(problem: WalkProblem, stances: Stances) -> WalkProblem:
    """Return the problem with its barometer factors and states P; unchanged without usable pressure."""
    recording, nodes = problem.recording, problem.nodes
    if recording.pressure is None or not problem.parameters.walk.barometer:
        return problem
    seen = average_pressures(recording, stances, nodes)
    barometer = calibrate_barometer(recording, seen)
    if barometer is None:
        return problem
    # Heights of the footfalls with a reading, and the state from one footfall to the next.
    known = np.flatnonzero(np.isfinite(seen.mean))
    keys = [(X(int(nodes.result[k])), P(int(k))) for k in known]
    t, states = recording.t[nodes.sample[nodes.result]], range(len(nodes.result))
    chain = [(P(k), P(k + 1)) for k in states[:-1]]
    factors = BarometerFactors(
        barometer,
        ResidualBlock(barometer.heights(seen, known), keys, kind=BAROMETER),
        ResidualBlock(barometer.drift(np.diff(t)), chain),
        GtsamFactors(barometer.prior(P(0))),
    )
    for k in states:
        problem.values.insert(P(k), np.zeros(2))
    note = (
        f"barometer in {len(factors.readings)} of {format_count(len(seen.mean), 'footfall')}, each to "
        f"{float(barometer.sigma_m(np.ones(1))[0]):.2f} m about an offset that drifts"
    )
    return problem.join(factors).with_note(note)


def spread_scale(factors: BarometerFactors, solved: Solved) -> Floats:
    """Return S (N, 1): S S^T is the covariance from the unknown scale of barometric heights, not estimated."""
    block = factors.readings
    residual, jacobians = block.evaluate(solved.linearized_at)
    heights = block.residuals
    assert isinstance(heights, BarometricHeight)
    # e = z + o - (1 + scale) h: the derivative by the scale is -h times that by the offset.
    by_scale = -jacobians[1][:, :, :1] * heights.height[:, None]
    sharing = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, by_scale)
    columns, information, pull = shared_information(solved.root, [sharing], 1)
    return columns.spread_untaken(information, pull, np.array([[SCALE_SIGMA**2]]))


def stride_factors(
    barometer: Barometer,
    seen: StancePressures,
    pose_key: int,
    height_m: float,
    states: tuple[int, int],
    elapsed_s: float,
    values: gtsam.Values,
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Return the barometer factors of a new footfall, the last of those `seen`, and the initial value of its state.

    `states` are the keys of the footfall before and of this one, `elapsed_s` later; `values` the estimate before it.
    """
    graph, new = gtsam.NonlinearFactorGraph(), gtsam.Values()
    (before, state), has_reading = states, bool(np.isfinite(seen.mean[-1]))
    reading = one_of(barometer.heights(seen, np.array([-1])), 0)
    if values.exists(before):
        new.insert(state, values.atVector(before))
        graph.push_back(factor_of(one_of(barometer.drift(np.array([elapsed_s])), 0), [before, state]))
    elif has_reading:
        # The first reading, or the first since the graph began again.
        offset = float(reading.height[0]) - height_m
        new.insert(state, np.array([offset, 0.0]))
        graph.push_back(barometer.prior(state, offset))
    if has_reading:
        graph.push_back(factor_of(reading, [pose_key, state]))
    return graph, new
