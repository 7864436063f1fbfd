"""A walk in progress with the sensor in a trouser pocket: samples in blocks of any size, one estimate for each stride.

    samples -> intake -> blocks of `BLOCK_S` -> orientation and steps (`pocket.online`)
            -> their path so far (`pocket.dead_reckoning`) -> estimate

The blocks are those of the stamps, so that nothing depends on how the samples came. An estimate is where the body is at
the end of a stride, and its heading is that of the stride. Every estimate adds up all steps so far, with the axes of
the thigh as they are known then. In the first strides they are uncertain, so the path turns about its origin; a degree
and more is a `Revision`. Their uncertainty is in the covariances here (`AXIS_SIGMA_DEG`), unlike in batch, which has
the axes of all the walk. So is what the filter learned of the heading later. While the gait does not show front and
back, a heading that was not given is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.causal import Footfall
from fg_nav.detection.mount import refuse_foot
from fg_nav.frames import yaw_rotation
from fg_nav.magnetic.axes import AlignedMagnetometer, align_magnetometer
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import TURNED_RAD, Revision, StanceEstimate, StrapdownPath, build_table, thin_rows
from fg_nav.online.navigator import METHOD, NO_ROWS, OnlineNavigator, SampleIntake
from fg_nav.pocket.dead_reckoning import (
    MOUNTING_SIGMA_DEG,
    STEP_HEADING_SIGMA_DEG,
    StepLength,
    SteppedPath,
    add_steps,
    propagate_corrections,
    turn_forward,
    use_step_constant,
)
from fg_nav.pocket.navigate import (
    assemble_solution,
    describe_steps,
    measure_first_heading,
    navigate_pocket,
    require_steps,
)
from fg_nav.pocket.online import OnlinePocket, StrideEnd
from fg_nav.pocket.track import STILL_S, choose_start
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.samples.stamps import MAX_GAP_S
from fg_nav.solution import Return, Solution, StanceTable

if TYPE_CHECKING:
    from fg_nav.online.record import GivenLines

BLOCK_S = 0.25  # Orientation and steps are found so often, s: twice a step.
AXIS_SIGMA_DEG = 8.0  # Of the axis of the swing, by one stride; it falls with the root of their number.


class _PathSoFar(NamedTuple):
    """Path of all steps, the direction (S, 2) of each and its sigma (S,) rad, and by how much the track is turned."""

    path: SteppedPath
    forward: Floats
    heading_sigma: Floats
    clockwise: float


class PocketNavigator(SampleIntake):
    """Navigates while samples come in, as `OnlineNavigator` does on a foot; a footfall is the end of a stride."""

    floor: None = None  # A pocket has no heights,
    returns: tuple[Return, ...] = ()  # and its path is not compared with itself.

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(heading_rad=None, mount="pocket"),
        remark: Callable[[str], None] = lambda words: None,
    ) -> None:
        """`remark` is given, in a sentence, what is odd about the samples; once for each kind of oddity."""
        super().__init__(remark)
        self.options, constant = options, options.step_constant_m
        self._step_length = StepLength() if constant is None else use_step_constant(constant)
        self.footfalls: list[Footfall] = []
        self._used = 0
        self._thigh: OnlinePocket | None = None
        self._reported: list[StanceEstimate] = []
        self._n_steps: list[int] = []  # until each line
        self._directions = np.empty((0, 2))  # of the steps, in the map of the last line
        self._given: list[StanceEstimate] = []  # of a resumed walk, lines that were given and not taken back
        self._gone = 0  # lines that were

    def _add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        self.buffer.append(rows)
        return self._add_blocks(at_end=False)

    def resume(self, given: GivenLines) -> None:
        """See `SampleIntake`: the same samples make the same lines, which are then left out."""
        self._given = [one for one in given.estimates if one.number not in given.retracted]
        self._gone = len(given.estimates) - len(self._given)

    def end_replay(self) -> list[StanceEstimate | Revision]:
        """See `SampleIntake`: what was made of the end of the samples is taken back."""
        lost = [(one.number, one.t) for one in self._given[len(self._reported) :]]
        self._gone += len(lost)
        self._given = self._given[: len(self._reported)]
        if not self._reported:
            return [Revision(lost[-1][1], 0.0, tuple(lost), np.empty((0, 4)))] if lost else []
        table = self.smoothed()
        path = np.column_stack([table.t, table.position])[thin_rows(len(table))]
        return [Revision(float(table.t[-1]), 0.0, tuple(lost), path)]

    def close(self) -> list[StanceEstimate | Revision]:
        """End the walk and return the estimates of the strides that were still open."""
        if self.has_ended:
            return []
        self.has_ended = True
        self.buffer.append(self.intake.push(NO_ROWS, at_end=True))
        found = self._add_blocks(at_end=True)
        return found if self._thigh is None else found + self._report(self._thigh.cut())

    @property
    def reported_continues(self) -> Sequence[bool]:
        """Which lines are further pieces of a standing: none."""
        return [False] * (len(self._reported) + self._gone)

    @property
    def stands(self) -> bool:
        """Whether the person stands, as far as is seen."""
        return self._thigh is None or self._thigh.stands

    def pose(self) -> StrapdownPath | None:
        """Return position and course at the last sample, as a path of one row: those of the newest line, if any."""
        if not self._reported:
            return None
        last, t = self._reported[-1], self.buffer.newest_s
        course = yaw_rotation(np.pi / 2 - last.heading)
        return StrapdownPath(np.array([t]), last.position[None], last.velocity[None], course[None])

    def causal(self) -> StanceTable:
        """Return one row an estimate, as it was reported; its attitude is that of the sensor."""
        return build_table([estimate.as_row() for estimate in self._reported])

    def smoothed(self) -> StanceTable:
        """Return one row an estimate, with its position as it is known now."""
        table = self.causal()
        if not len(table):
            return table
        path = self._reckon_path().path
        at = np.maximum(2 * np.array(self._n_steps) - 1, 0)
        return replace(table, position=path.position[at], position_cov=path.covariance[at], pose_cov=None)

    def recording(self) -> Recording:
        """Return all samples; raises `RecordingError` if there are too few."""
        return self._cut_until(self.buffer.stop, self.options.use_field)

    def finish(self) -> Solution:
        """End the walk and return its steps with the axes known then, and the orientation of the moment between them.

        Raises `RecordingError`, `EstimationError` where there was no walk, or the sensor was on a foot.
        """
        began = perf_counter()
        self.close()
        recording = self.recording()
        refuse_foot(recording)
        thigh = self._begin_thigh(self.buffer.stop) if self._thigh is None else self._thigh
        steps = thigh.steps.steps
        require_steps(steps)
        so_far = self._reckon_path()
        track = thigh.build_track(recording.t).rotate(so_far.clockwise)
        solution = assemble_solution(recording, track, steps, so_far.path, self._step_length)
        notes = describe_steps(steps, self._step_length, thigh.is_forward_known)
        return replace(
            solution,
            method=METHOD,
            runtime_s=self._busy_s + perf_counter() - began,
            notes=(*thigh.notes, *notes, *self.intake.notes),
            moment=self.causal(),
        )

    def polish(self, progress: Callable[[float], None] | None = None, *known: object) -> Solution:
        """End the walk and solve it as a whole in batch; errors as of `finish`."""
        self.close()
        recording, options = self.recording(), self.options
        aligned = AlignedMagnetometer(recording)
        if options.use_field:
            aligned = align_magnetometer(recording, options.axes_given)
        given = options.heading_rad, options.step_constant_m
        found = navigate_pocket(aligned.recording, "pocket", *given, progress=progress)
        return replace(found, notes=(*aligned.notes, *found.notes))

    def _add_blocks(self, at_end: bool) -> list[StanceEstimate | Revision]:
        """Process whole blocks, those with a later sample, `at_end` the rest too; return estimates and revisions."""
        rows = self.buffer.between(self._used, self.buffer.stop)
        if not len(rows):
            return []
        block = np.floor((rows[:, 0] - self.buffer.stamp(0)) / BLOCK_S + 1e-6)
        ends = 1 + np.flatnonzero((np.diff(block) > 0) | (np.diff(rows[:, 0]) > MAX_GAP_S))
        found: list[StanceEstimate | Revision] = []
        for end in (self._used + np.append(ends, [len(rows)] if at_end else [])).astype(int).tolist():
            if self._thigh is None:
                # The orientation begins with a second of samples.
                if end < MIN_SAMPLES or self.buffer.stamp(end - 1) - self.buffer.stamp(0) < STILL_S:
                    continue
                self._thigh = self._begin_thigh(end)
            first, self._used = self._used, end
            rows = self.buffer.between(first, end)
            if not self.options.use_field:
                rows[:, 7:10] = np.nan
            found += self._report(self._thigh.push(rows))
        return found

    def _begin_thigh(self, end: int) -> OnlinePocket:
        first = self._cut_until(end, self.options.use_field)
        start, notes = choose_start(first, self.options.heading_rad)
        return OnlinePocket(start, first.period_s, notes=tuple(notes))

    def _reckon_path(self) -> _PathSoFar:
        """Return the path of all steps, with the present estimate of the thigh's axes."""
        assert self._thigh is not None
        given, thigh = self.options.heading_rad, self._thigh
        known, axes = thigh.steps, thigh.axes
        assert axes is not None
        forward = turn_forward(known.attitude @ axes[0])
        clockwise = 0.0 if given is None else given - measure_first_heading(forward)
        forward = forward @ yaw_rotation(-clockwise)[:2, :2].T
        # The uncertainty of the axes turns all of the path; a given heading is that of the path, whatever the axes.
        axis_sigma = np.radians(AXIS_SIGMA_DEG) * (2.0 / len(forward)) ** 0.5 if thigh.is_forward_known else np.pi
        sigma = np.hypot(known.heading_sigma, axis_sigma if given is None else 0.0)
        along = self._step_length.predict(known.steps)[:, None] * forward
        unseen = propagate_corrections(along, known.heading_sigma**2)
        unseen += known.lost_m2[:, None, None] * np.eye(2)
        path = add_steps(known.steps, forward, sigma, self._step_length, unseen)
        return _PathSoFar(path, forward, np.maximum.accumulate(sigma), clockwise)

    def _report(self, ends: list[StrideEnd]) -> list[StanceEstimate | Revision]:
        """Return the estimates at the ends of strides, after a revision where the axes turn by `TURNED_RAD`."""
        if not ends:
            return []
        so_far, revised = self._reckon_path(), list[Revision]()
        # Mean turn (rad, clockwise) of the reported steps by the present axes of the thigh.
        known = len(self._directions)
        old, new = self._directions @ [1j, 1.0], so_far.forward @ [1j, 1.0]
        turn = float(np.angle((new[:known] * old.conj()).sum()))
        if abs(turn) < TURNED_RAD or not self._reported:
            self._directions = np.concatenate([self._directions, so_far.forward[known:]])
        else:
            self._directions = so_far.forward
            thinned = thin_rows(len(self._n_steps))
            at = [max(2 * self._n_steps[k] - 1, 0) for k in thinned]
            path = np.column_stack([[self._reported[k].t for k in thinned], so_far.path.position[at]])
            revised = [Revision(self._reported[-1].t, turn, (), path)]
        # The estimates, each with a footfall at the end of its stride.
        known = len(self._given) - len(self._reported)
        found = [self._make_estimate(len(self._reported) + self._gone + k, end, so_far) for k, end in enumerate(ends)]
        for end in ends:
            start = np.array([end.sample])
            self.footfalls.append(Footfall(start, start + 1, np.ones(1), end.sample, continues=False))
        self._n_steps += [end.steps for end in ends]
        self._reported += found
        return [*revised, *found] if known <= 0 else [*found[known:]]

    def _make_estimate(self, number: int, end: StrideEnd, so_far: _PathSoFar) -> StanceEstimate:
        assert self._thigh is not None
        path, latest = so_far.path, self._thigh.latest
        # Heading and velocity are those of the last two steps, at the start of the first two.
        last = max(end.steps, 2)
        start, stop = 2 * (last - 2), 2 * last - 1
        moved = path.position[stop] - path.position[start]
        took = self.buffer.stamp(int(path.sample[stop])) - self.buffer.stamp(int(path.sample[start]))
        at = max(2 * end.steps - 1, 0)
        own = np.radians([MOUNTING_SIGMA_DEG, STEP_HEADING_SIGMA_DEG / 2**0.5])
        pose_cov = np.zeros((4, 4))
        pose_cov[:3, :3] = path.covariance[at]
        pose_cov[3, 3] = so_far.heading_sigma[last - 1] ** 2 + (own**2).sum()
        verdict, reason = self._thigh.judge_field()
        return StanceEstimate(
            number=number,
            sample=end.sample,
            t=end.t,
            position=path.position[at],
            nav_R_body=yaw_rotation(-so_far.clockwise) @ end.nav_R_body,
            heading=float(np.arctan2(moved[0], moved[1])),
            velocity=moved / took,
            gyro_bias=latest.gyro_bias,
            pose_cov=pose_cov,
            gyro_bias_sigma=latest.sigma[3:],
            compass_weight=np.nan,
            field=verdict,
            field_reason=reason,
        )


Navigator: TypeAlias = OnlineNavigator | PocketNavigator


def begin_walk(options: OnlineOptions, remark: Callable[[str], None], background: bool = False) -> Navigator:
    """Return the navigator of a new walk, on a foot or in a pocket; arguments as of `OnlineNavigator`."""
    is_pocket = options.mount == "pocket"
    return PocketNavigator(options, remark) if is_pocket else OnlineNavigator(options, remark, background)


def compute_stride_headings(table: StanceTable) -> Floats:
    """Return the heading (K,) rad of the stride up to each row, of the first one at the start, as in the lines."""
    moved = np.diff(table.position[:, :2], axis=0)
    heading = np.arctan2(moved[:, 0], moved[:, 1])
    return np.append(heading[:1], heading)
