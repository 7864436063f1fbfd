"""How noisy the gyroscope is in a swing, told by the walk itself.

`gyr_relative_density` k (1/sqrt(Hz)) makes the rate noise of a swinging foot: s_w^2 = density^2 + (k |w|)^2. It stands
for scale, misalignment, coning between samples, a mount that gives, a range that is too small; it differs tenfold from
sensor to sensor and from gait to gait, and too large a k costs as much as too small a one. The evidence of a few dozen
strides tells it. With a graph that is linear about its minimum, and all that does not depend on k left out,

    -log p(z | k) = E + log|R| + 1/2 sum_i log|S_i(k)|                 (Laplace; MacKay 2003, section 27)

E the error at the minimum, R the triangle of its square-root information, S_i the noise covariance of inertial
factor i. The largest k is taken whose evidence is within `MOST_NATS` of the best: what the walk does not show stays
pessimistic.

Pieces. The strides come in up to `PIECES` stretches from the beginning, the middle and the end, each with a gauge of
its own, and their evidence is added. No k is taken that a piece alone finds too small by more than `MOST_NATS`: a walk
that is run in part is believed no more than its running allows. Beyond `PIECES * PIECE_STRIDES` strides the cost is
constant.

Cost. The noise covariance of an interval is linear in k^2, so two preintegrations give it for every k:

    S(k) = S(k0) + (k^2 - k0^2) / (k1^2 - k0^2) (S(k1) - S(k0))
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import gtsam
import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.recording import Recording
from fg_nav.smoother.initial import initial_values
from fg_nav.smoother.nodes import place_nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.preintegration import preintegrate
from fg_nav.smoother.solver import solve, time_order
from fg_nav.smoother.strides import VelocityTies, add_start, add_stride, gauge, strides_of
from fg_nav.stances import Stances
from fg_nav.start import starting_point
from fg_nav.wording import counted

LEVELS = (2e-3, 1e-3, 3e-4, 1e-4)
"""1/sqrt(Hz), falling. 2e-3 is a consumer sensor in a run; 1e-4 is the white noise of a good one over a swing."""

PIECES, PIECE_STRIDES = 3, 50
"""150 strides tell 3e-4 from 1e-4 by some 5 nats, 1e-3 from 3e-4 by 30."""

LONGEST_PIECE_S = 90.0
"""A third more than 50 strides take; who stands in between shows nothing of a swing."""

STANDING_S = 1.0
"""Of the standing before the first swing and after the last."""

FEWEST_STRIDES = 8
"""A walk of fewer keeps the level it was given."""

INERTIAL_KEYS = 5
"""An inertial factor joins two poses, two velocities and a bias; none other joins as many."""

MOST_NATS = 3.0
"""Twenty to one: what counts as strong evidence (Kass and Raftery 1995)."""


@dataclass(frozen=True)
class SwingNoise:
    """The level `gyr_relative_density` (1/sqrt(Hz)) for a walk, and in words how it came about."""

    gyr_relative_density: float
    note: str


def swing_noise(
    recording: Recording,
    stances: Stances,
    gyro_bias: Floats,
    gyro_bias_sigma: float,
    lever: Floats,
    p: SmootherParameters,
    levels: tuple[float, ...] = LEVELS,
) -> SwingNoise:
    """Choose the noise of the rate in a swing.

    Parameters
    ----------
    recording, stances
        Of the same length.
    gyro_bias, gyro_bias_sigma
        Bias (3,) to linearise at and sigma of its prior about zero, rad/s.
    lever : Floats
        (3,) m, of the rolling foot.
    p : SmootherParameters
        All else; its own `gyr_relative_density` is kept where the walk is too short to tell.
    levels : tuple of float
        To choose from, 1/sqrt(Hz), falling.
    """
    evidences, strides = [], 0
    for piece_recording, piece_stances in _pieces(recording, stances):
        try:
            piece = _Piece(piece_recording, piece_stances, gyro_bias, gyro_bias_sigma, lever, p)
            evidences.append([piece.minus_log_evidence(level) for level in levels])
        except EstimationError:
            continue
        strides += piece_stances.n_footfalls - 1
    if not evidences:
        level = p.gyr_relative_density
        return SwingNoise(level, f"swing noise {_words(level)}: too few strides to tell it from")
    level = choose(levels, np.array(evidences))
    return SwingNoise(level, f"swing noise {_words(level)}, the evidence of {counted(strides, 'stride')}")


def choose(levels: tuple[float, ...], minus_log_evidence: Floats) -> float:
    """Level for a walk from the evidence (pieces, levels): see above."""
    level = np.array(levels)
    together = _near_best(minus_log_evidence.sum(axis=0))
    alone = _near_best(minus_log_evidence)
    least = max(level[piece].min() for piece in alone)
    return float(max(level[together].max(), least))


def _near_best(minus_log_evidence: Floats) -> Bools:
    best = minus_log_evidence.min(axis=-1, keepdims=True)
    return np.asarray(minus_log_evidence <= best + MOST_NATS)


def _words(level: float) -> str:
    return f"{np.degrees(level):.2g} deg/s/sqrt(Hz) per rad/s"


def _pieces(recording: Recording, stances: Stances) -> Iterator[tuple[Recording, Stances]]:
    """Cut out the stretches to choose by; they do not overlap."""
    strides = stances.n_footfalls - 1
    if strides < FEWEST_STRIDES:
        return
    pieces = min(PIECES, -(-strides // PIECE_STRIDES))
    length = min(strides // pieces, PIECE_STRIDES)
    for first in np.linspace(0, strides - length, pieces).astype(int):
        cut = _cut(recording, stances, first, first + length)
        if cut[1].n_footfalls > FEWEST_STRIDES:
            yield cut


def _cut(recording: Recording, stances: Stances, first: int, last: int) -> tuple[Recording, Stances]:
    """Footfalls `first <= k <= last` or what `LONGEST_PIECE_S` holds of them, and little standing at the ends."""
    t = recording.t
    number = np.arange(first, last + 1)
    arrives = stances.start[np.searchsorted(stances.footfall, number)]
    leaves = stances.stop[np.searchsorted(stances.footfall, number, side="right") - 1]
    begin = max(int(arrives[0]), int(np.searchsorted(t, t[leaves[0] - 1] - STANDING_S)))
    held = arrives[t[arrives] <= t[begin] + LONGEST_PIECE_S][-1]
    leaves_last = int(leaves[arrives == held][0])
    end = min(leaves_last, int(np.searchsorted(t, t[held] + STANDING_S)) + 1)
    inside = (stances.stop > begin) & (stances.start < end)
    footfall = stances.footfall[inside]
    cut = replace(
        stances,
        start=np.maximum(stances.start[inside], begin) - begin,
        stop=np.minimum(stances.stop[inside], end) - begin,
        footfall=footfall - footfall[0],
        n_samples=end - begin,
        statistic=None if stances.statistic is None else stances.statistic[begin:end],
    )
    return recording.slice(begin, end), cut


class _Piece:
    """The graph of a stretch, its noise free to change."""

    def __init__(
        self,
        recording: Recording,
        stances: Stances,
        gyro_bias: Floats,
        gyro_bias_sigma: float,
        lever: Floats,
        p: SmootherParameters,
    ) -> None:
        self._p = p
        start = starting_point(recording, stances, 0.0, p.rest)
        nodes = place_nodes(recording, stances, p)
        self._order = time_order(nodes)
        self._graph, self._ties = gtsam.NonlinearFactorGraph(), VelocityTies()
        add_start(self._graph, gyro_bias_sigma, p)
        self._graph.push_back(gauge(start.nav_R_body, p.gauge_sigma, p))
        bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyro_bias)
        low, high = (
            list(preintegrate(recording, nodes.sample, bias, replace(p, gyr_relative_density=level))) for level in _BASE
        )
        strides = strides_of(recording, stances, nodes, iter(low), gyro_bias, lever, (), p)
        for stride in strides:
            add_stride(self._graph, self._ties, stride, p)
        self._at_zero = np.array([measured.preintMeasCov() for measured in low])
        self._by_square = np.array([measured.preintMeasCov() for measured in high]) - self._at_zero
        self._values = initial_values(recording, stances, nodes, start.nav_R_body, gyro_bias, p.gravity)
        factors = ((i, self._graph.at(i)) for i in range(self._graph.size()))
        self._inertial = [(i, cast("gtsam.GalileanImuFactor", f)) for i, f in factors if f.size() == INERTIAL_KEYS]

    def minus_log_evidence(self, level: float) -> float:
        """Of the swing noise `level`, up to a constant."""
        covariance = self._at_zero + (level / _BASE[1]) ** 2 * self._by_square
        for (i, factor), noise in zip(self._inertial, covariance, strict=True):
            self._graph.replace(i, factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.Covariance(noise)))
        p = self._p
        solved = solve(self._graph, [self._ties], self._values, self._order, p.convergence, p.largest_steps)
        self._values = solved.values
        error = self._graph.error(solved.values) + self._ties.error(solved.values)
        return float(error + _log_root(solved.tree) + 0.5 * np.linalg.slogdet(covariance)[1].sum())


_BASE = (0.0, 1e-3)
"""The two levels that are integrated, 1/sqrt(Hz): without noise of the swing, and with some."""


def _log_root(tree: gtsam.GaussianBayesTree) -> float:
    """log|R|, half the logarithm of the determinant of the information."""
    total, stack = 0.0, list(tree.roots())
    while stack:
        clique = stack.pop()
        total += float(np.log(np.abs(np.diagonal(clique.conditional().R()))).sum())
        stack += [clique[i] for i in range(clique.nrChildren())]
    return total
