"""The barometer of a walk: pressures in its stances become heights, whose offset drifts, in batch and online alike.

    p_k     mean pressure about the stillest sample of footfall k, within its stance and `REACH_S`, Pa
    h_k     R T_0 / (g M) log(p_0 / p_k), m above the first footfall with a reading, T_0 = 15 degC
    factor  height of the sensor + offset = h_k, Cauchy's loss      (`factors.walk_constraints`)

Offset and tendency are a state P of each footfall:

offset    of wind, ventilation and doors, a random walk of `DRIFT_PA`, with Cauchy's loss: doors left open are steps.
tendency  of the weather, constant for hours: 1 hPa in three hours, the mean of the mid-latitudes, 33 Pa in one.

Air of another temperature has heights larger by a scale of 0 +- `SCALE_SIGMA`, one number of a walk. It is not taken
off, but counted in the sigmas as the moving foot is (`shared_errors`). A walk in progress has the prior instead.

Noise of p_k is the recording's own, with parts that no recording shows,

    sigma^2 = (noise^2 + `AIR_PA`^2) min(1, n / n_k) + run quantum^2 / 12,

n_k the readings of footfall k, n the median: a standing averages over more. noise is half of what the means of the two
halves of a stance differ by, in the median: white noise, and what the sensor's low-pass makes of it, as the foot does
not move. Where stances have too few readings it is that of second differences at the barometer's rate. Readings in
steps of a quantum err alike as long as they stay the same: over `run` footfalls in the mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import P, X

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.factors.residual import ResidualBlock, factor_of, one_of
from fg_nav.factors.walk_constraints import BarometerDrift, BarometricHeight
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.sensitivity import SharingFactors, shared_information
from fg_nav.smoother.solver import GtsamFactors, Solved
from fg_nav.smoother.strides import Nodes
from fg_nav.text import format_count

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
class Barometer:
    """The pressure p_0 from which heights count, and what is known of the noise of a footfall's, Pa.

    `white_pa` of the mean over `readings` of a stance, and `common_pa` of any mean.
    """

    reference_pa: float
    white_pa: float
    common_pa: float
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
    """Pressures about the stillest sample of each footfall.

    ====== ===================================================
    mean   (F,) Pa; NaN without a reading
    halves (F,) Pa by which the means of the halves of its readings differ
    number (F,) of readings
    ====== ===================================================
    """

    mean: Floats
    halves: Floats
    number: Floats


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


@dataclass(frozen=True)
class BarometerFactors:
    """Factors of the barometer of a walk: `readings`, `drift` and the prior on the first state."""

    barometer: Barometer
    readings: ResidualBlock
    drift: ResidualBlock
    prior: GtsamFactors


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
        ResidualBlock(barometer.heights(seen, known), keys),
        ResidualBlock(barometer.drift(np.diff(t)), chain),
        GtsamFactors(barometer.prior(P(0))),
    )
    for k in states:
        problem.values.insert(P(k), np.zeros(2))
    note = (
        f"barometer in {len(factors.readings)} of {format_count(len(seen.mean), 'footfall')}, each to "
        f"{float(barometer.sigma_m(np.ones(1))[0]):.2f} m about an offset that drifts"
    )
    return replace(problem, barometer=factors).with_note(note)


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
    """Return the barometer factors of a new footfall, and the initial value of its state, empty without a reading.

    Parameters
    ----------
    seen : pressures of the window; the new footfall is the last.
    pose_key, height_m : pose of the footfall at its stillest sample, and the height estimated there.
    states : keys of the states of the footfall before and of this one, `elapsed_s` later.
    values : current estimate, before this footfall.
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
