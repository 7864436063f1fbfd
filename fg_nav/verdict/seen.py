"""What several signs need of a walk and its solution."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.handedness import AxesEvidence, measure_axes, measure_swing_axes
from fg_nav.detection.mount import TurnSigns, measure_turning
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.quasi_static import QUASI_STATIC
from fg_nav.mechanisation import integrate_strides
from fg_nav.samples.gaps import list_bridged
from fg_nav.solution import Solution
from fg_nav.system.spilled import measure_rows
from fg_nav.walk import Walk, ignores_field

SPAN_S = 0.1  # Over which the speed is taken from the places.
RUN_CYCLE_S = 0.85  # Strides that are shorter, median, are those of a run: the foot is never as still.


class Seen:
    """A walk and its solution, and what several signs need of them.

    Strides are those from one row of the solution's table to the next; the recording is the one that was solved.
    """

    def __init__(self, walk: Walk, solution: Solution) -> None:
        self.walk, self.solution = walk, solution
        self.recording = walk.recording if solution.recording is None else solution.recording

    @cached_property
    def strides(self) -> Floats:
        """(K, 3) m, from footfall to footfall."""
        return np.diff(self.solution.stances.position, axis=0)

    @cached_property
    def lengths(self) -> Floats:
        """(K,) m, over the ground."""
        return np.hypot(self.strides[:, 0], self.strides[:, 1])

    @cached_property
    def way(self) -> float:
        """Length of the path over the ground, m."""
        return float(self.lengths.sum())

    @cached_property
    def sigma(self) -> float:
        """Of the end over the ground that the result claims, m; none without footfalls."""
        return float(np.hypot(*self.solution.stances.position_sigma[-1, :2])) if len(self.solution.stances) else 0.0

    @cached_property
    def stride_speed(self) -> Floats:
        """(K,) m/s, of each stride in space; 0 where the foot was not recorded in between."""
        t = self.solution.stances.t
        speed = np.linalg.norm(self.strides, axis=1) / np.maximum(np.diff(t), 1e-9)
        return np.where(np.diff(self.sum_bridged(t)) > 0.0, 0.0, speed)

    @cached_property
    def usual_m_s(self) -> float:
        """Median speed of the strides, m/s."""
        return float(np.median(self.stride_speed)) if len(self.strides) else 0.0

    def displace_end(self, turn: Floats) -> float:
        """By how much an error of the heading, (K + 1,) rad at the rows, displaces the end, m, to first order."""
        east, north = ((turn[1:] + turn[:-1]) / 2) @ self.strides[:, :2]
        return float(np.hypot(east, north))

    @cached_property
    def fastest(self) -> Floats:
        """(K,) m/s, the highest speed in each stride."""
        speed = np.linalg.norm(self.solution.velocity, axis=1)
        sample = self.solution.stances.sample
        return np.maximum.reduceat(speed[: sample[-1]], sample[:-1]) if len(sample) > 1 else np.zeros(0)

    @cached_property
    def gravity(self) -> Floats:
        """(K,) m/s^2, the mean force along the vertical in each stride, which begins and ends at rest."""
        return np.asarray(GRAVITY_M_S2 + self.ends[0][:, 2] / np.diff(self.solution.stances.t))

    @cached_property
    def speed(self) -> Floats:
        """(N,) m/s, of the whole path, by its velocity and by its places `SPAN_S` apart; the greater of the two."""
        solution, over = self.solution, max(1, round(SPAN_S / self.recording.period_s))
        speed = measure_rows(solution.velocity)
        moved = np.linalg.norm(solution.position[over:] - solution.position[:-over], axis=1)
        speed[over:] = np.maximum(speed[over:], moved / (solution.t[over:] - solution.t[:-over]))
        return speed

    @cached_property
    def axes(self) -> AxesEvidence:
        """What strides show of the axes of gyroscope and accelerometer."""
        measure = measure_swing_axes if self.walk.options.mount == "pocket" else measure_axes
        return measure(self.recording.t, self.recording.acc, self.recording.gyr)

    @cached_property
    def swings(self) -> Floats:
        """(K,) s without a stance, from footfall to footfall."""
        stances, t = self.walk.stances, self.recording.t
        between = np.diff(stances.footfall) > 0
        spans = np.stack([t[stances.stop[:-1] - 1], t[stances.start[1:]]])[:, between]
        return np.asarray(np.diff(spans - self.sum_bridged(spans), axis=0)[0])

    def sum_bridged(self, t: Floats) -> Floats:
        """Time until t, s, in which this foot was not recorded, and the other one was."""
        beside = self.walk.beside
        if beside is None:
            return np.zeros(t.shape)
        bridged = list_bridged(self.recording.t, beside)
        if not len(bridged):
            return np.zeros(t.shape)
        so_far = np.cumsum(np.diff(bridged, axis=1))
        both_ends = np.stack([np.append(0.0, so_far[:-1]), so_far], axis=1)
        return np.asarray(np.interp(t, bridged.ravel(), both_ends.ravel()))

    @cached_property
    def gait(self) -> float:
        """How much a foot may move in its stances, as a multiple of a walk's: 2 in a run."""
        runs = len(self.strides) > 0 and float(np.median(np.diff(self.solution.stances.t))) < RUN_CYCLE_S
        return 2.0 if runs else 1.0

    @cached_property
    def ends(self) -> tuple[Floats, Floats]:
        """Velocity (K, 3) m/s and vertical axis (K, 3) in the body at the end of each stride, by strapdown alone."""
        table, (acc, gyr) = self.solution.stances, self.recording.integrable
        h = np.append(np.diff(self.recording.t), self.recording.period_s)
        attitude = np.array(table.nav_R_body, order="C")
        bias = np.ascontiguousarray(table.gyro_bias)
        strides = table.sample[:-1], table.sample[1:]
        velocity = integrate_strides(acc, gyr, h, *strides, attitude, bias, GRAVITY_M_S2)
        self.recording.release()
        return velocity, attitude[: len(velocity), 2]

    @property
    def holds_heading(self) -> bool:
        """Whether something outside the gyroscope shows a filter the heading along the walk."""
        return QUASI_STATIC in self.solution.stances.field and not ignores_field(self.solution.method)

    @cached_property
    def turning(self) -> TurnSigns:
        """How the sensor turns."""
        return measure_turning(self.recording)
