"""Ties between footfalls that come from people and buildings, not from the sensor. Off unless asked for.

Straight on (`factors.straight_walk`). Of the footfalls n strides apart, each three in a row have the change of course r
over sigma, x, and the loss rho(x) of the mixture of straight and anything. It is linearised with the weight w(x) that
the mixture gives at hand, and what is above the weighted square is kept in a second row that depends on nothing,

    [ sqrt(w) dr/sigma | -sqrt(w) x ],    [ 0 | sqrt(2 rho - w x^2) ],

so that half the square of both at the point of linearisation is rho, and anywhere else above it: the error that the
linear model promises is one the loss keeps, and the solver's criterion is meaningful. Nothing is believed in a curve,
as a row of zeros holds no information.

A corner that begins within the last stride of a displacement turns its course by a few degrees, which passes for
straight. On a walk that turns one way more often than the other such changes do not cancel: on loops to the right they
were worth 0.04 deg a stride. So no footfall may stand farther off the line between the ends of its displacement than
people weave; drift bends such a line by centimetres.

Floors (`factors.floor_height`). Each floor has its height Z as a variable. Ties from footfall to footfall would do
without, but sum up to a walk of their own: after a thousand strides a floor of ties of 2 cm is as steep as 0.6 m. A
variable costs one row in each clique between the first footfall on a floor and the last, and floors are few.

Which footfall is on which floor is proposed from a first solution. Its height drifts by metres, smoothly: some
millimetres a stride, while a stride on stairs climbs decimetres. `stepped` keeps of the heights what was climbed in
strides above the step, and of that the floors are proposed; how long the walk stayed away makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X, Z

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.floor_height import floor_height_jacobian, floor_height_residual, floor_labels
from fg_nav.factors.straight_walk import (
    StraightParameters,
    straight_probability,
    straight_triples,
    straight_walk_jacobians,
    straight_walk_loss,
    straight_walk_residual,
)
from fg_nav.smoother.nodes import Nodes
from fg_nav.smoother.solver import Part
from fg_nav.smoother.walk_parameters import WalkParameters


class StraightTies:
    """The changes of course of a walk, between the footfalls `triples` (M, 3)."""

    def __init__(self, nodes: Nodes, triples: Ints, p: StraightParameters) -> None:
        self._node = nodes.result[triples]
        self._p = p

    def __len__(self) -> int:
        return len(self._node)

    def error(self, values: gtsam.Values) -> float:
        """Sum of the losses of the mixture."""
        return float(straight_walk_loss(self._whitened(_poses(values, self._node)[0]), self._p.odds_of_curve).sum())

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield one factor of two rows for each change of course."""
        point, attitude = _poses(values, self._node)
        x = self._whitened(point)
        weight = straight_probability(x, self._p.odds_of_curve)
        above = 2.0 * straight_walk_loss(x, self._p.odds_of_curve) - weight * x**2
        by_point = np.stack(straight_walk_jacobians(*np.moveaxis(point, 1, 0)), axis=1)
        by_pose = np.zeros((*self._node.shape, 2, 6))
        scale = np.sqrt(weight)[:, None, None] / self._p.sigma
        by_pose[:, :, 0, 3:] = scale * np.einsum("mti,mtij->mtj", by_point, attitude)
        right = np.stack([-np.sqrt(weight) * x, np.sqrt(np.maximum(above, 0.0))], axis=1)
        unit = gtsam.noiseModel.Unit.Create(2)
        for (i, j, k), (before, here, after), b in zip(self._node, by_pose, right, strict=True):
            yield gtsam.JacobianFactor(X(i), before, X(j), here, X(k), after, b, unit)

    def _whitened(self, point: Floats) -> Floats:
        """Changes of course (M,) of three points each (M, 3, 3), over sigma."""
        return straight_walk_residual(*np.moveaxis(point, 1, 0)) / self._p.sigma


class FloorTies:
    """The heights of footfalls above their floors, footfall by footfall `label` (F,), -1 on none."""

    def __init__(self, nodes: Nodes, label: Ints, sigma_m: float) -> None:
        self._node = nodes.result[label >= 0]
        self._floor = label[label >= 0]
        self._sigma = sigma_m

    def __len__(self) -> int:
        """Count the floors."""
        return int(self._floor.max(initial=-1)) + 1

    def insert(self, values: gtsam.Values) -> None:
        """Put each floor at the mean height of its footfalls."""
        height = _poses(values, self._node)[0][:, 2]
        for floor in range(len(self)):
            values.insert(Z(floor), np.array([height[self._floor == floor].mean()]))

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigma."""
        return 0.5 * float((self._residuals(values)[0] ** 2).sum())

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield one factor a footfall."""
        residual, attitude = self._residuals(values)
        by_pose = floor_height_jacobian(attitude) / self._sigma
        by_floor = -np.eye(1) / self._sigma
        unit = gtsam.noiseModel.Unit.Create(1)
        for j, floor, A, b in zip(self._node, self._floor, by_pose, -residual, strict=True):
            yield gtsam.JacobianFactor(X(j), A, Z(floor), by_floor, b, unit)

    def _residuals(self, values: gtsam.Values) -> tuple[Floats, Floats]:
        """Residuals over sigma (J, 1), and attitudes (J, 3, 3)."""
        point, attitude = _poses(values, self._node)
        height = np.array([values.atVector(Z(floor))[0] for floor in range(len(self))])
        return floor_height_residual(point[:, 2], height[self._floor]) / self._sigma, attitude


@dataclass(frozen=True)
class WalkTies:
    """What is believed of a walk beyond its sensor: parts of the graph, and the number of floors among them."""

    parts: tuple[Part, ...] = ()
    floors: int = 0

    def ordering(self, ordering: gtsam.Ordering) -> gtsam.Ordering:
        """Return the order of elimination with the floors after all else, as the walk may come back to each."""
        ordering = gtsam.Ordering(ordering)
        for floor in range(self.floors):
            ordering.push_back(Z(floor))
        return ordering


def walk_ties(nodes: Nodes, values: gtsam.Values, p: WalkParameters, *others: Part) -> WalkTies:
    """Tie the footfalls of a walk from a first solution, into whose values the floors are put; with other parts."""
    position = _poses(values, nodes.result)[0]
    parts = list(others)
    floors = 0
    if p.straight:
        triples = straight_triples(position, p.straight_walk)
        triples = triples[off_line(position, triples) <= p.straight_within_m]
        parts.append(StraightTies(nodes, triples, p.straight_walk))
    if p.floors:
        label = floor_labels(stepped(position[:, 2], p.floor.step_m), p.floor)
        on_floors = FloorTies(nodes, label, p.floor_sigma_m)
        on_floors.insert(values)
        floors = len(on_floors)
        parts.append(on_floors)
    return WalkTies(tuple(parts), floors)


def off_line(position: Floats, triples: Ints) -> Floats:
    """How far (M,) m over ground footfalls stand off the lines from the first to the second of three and on."""
    farthest = [max(_off_line(position[i : j + 1, :2]) for i, j in pairwise(triple)) for triple in triples]
    return np.array(farthest, dtype=np.float64)


def _off_line(place: Floats) -> float:
    """How far one of some places (N, 2) is from the line from the first to the last."""
    along = place[-1] - place[0]
    from_first = place - place[0]
    across = from_first[:, 0] * along[1] - from_first[:, 1] * along[0]
    return float(np.abs(across).max() / np.linalg.norm(along))


def stepped(height: Floats, step_m: float) -> Floats:
    """Heights (F,) m with all changes of no more than a step taken out, from zero."""
    climbed = np.diff(height, prepend=height[:1])
    return np.cumsum(np.where(np.abs(climbed) > step_m, climbed, 0.0))


def _poses(values: gtsam.Values, node: Ints) -> tuple[Floats, Floats]:
    """Positions (..., 3) and attitudes (..., 3, 3) at nodes (...)."""
    poses = [values.atPose3(X(int(j))) for j in node.ravel()]
    point = np.array([pose.translation() for pose in poses]).reshape(*node.shape, 3)
    return point, np.array([pose.rotation().matrix() for pose in poses]).reshape(*node.shape, 3, 3)
