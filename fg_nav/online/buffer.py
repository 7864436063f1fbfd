"""The samples and footfalls of a walk in progress, parts of it as recordings with their stances, its options.

Samples, footfalls and stance intervals are counted from the first of the walk, discarded ones too.

A part of a walk does not show everything about its sensor. Sample period and clipping levels, delay and axes of the
magnetometer are those of the walk when it was last cut out as a whole (`SensorState`). A part is corrected by the iron
of the last solution; the whole is not, as the next one estimates it anew.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration import MagnetometerCalibration
from fg_nav.detection.causal import Footfall
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.magnetic.axes import MagAxes, MagnetometerDelay, align_magnetometer, remove_delay
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.readings import COLUMNS, TAKEN, find_saturation_level
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.truth import Fix, check_fixes

if TYPE_CHECKING:
    from fg_nav.walk import Mount

CHUNK = 1 << 12  # Rows; 0.3 MB.
AT_END = 0.97  # Share of the largest reading, from which on a level may be that of a range: calibration smears it.
SETTLED_S = 5e-4  # Sigma of a delay that is not estimated again.
LEAD_S = 0.25  # Readings so long before a part of the walk are used for the field at its first samples.
SAMPLES_BEFORE = 40  # A node, that are cut out with those after it: enough for a recording.


@dataclass(frozen=True, kw_only=True)
class OnlineOptions:
    """What a user can choose; raises `EstimationError` for fixes that cannot be."""

    # Of the body's x axis at the first stance, clockwise from north. None where it is not known: then zero, or with the
    # field so that the mean field points north (from footfall 4 on, refined each time the walk is solved again).
    heading_rad: float | None = 0.0
    use_field: bool = True  # Whether the magnetometer is used; samples without one are then allowed.
    lag_s: float | None = None  # How far back the past is corrected; None for the whole walk.
    parameters: SmootherParameters = field(default_factory=SmootherParameters)
    axes_given: bool = False  # Whether the magnetometer is used whatever its axes look like.
    fixes: tuple[Fix, ...] = ()  # Positions known from elsewhere, at times of the walk to come.
    calibration: MagnetometerCalibration | None = None  # Already applied; None to estimate it on the walk.
    step_constant_m: float | None = None  # Of the person (`fg_nav.pocket.dead_reckoning`); None for the default.
    mount: Mount = "foot"  # Where the sensor is worn.

    def __post_init__(self) -> None:
        check_fixes(self.fixes)
        if self.fixes and self.fixes[0].origin is not None:
            raise EstimationError("online the start is the origin: give fixes in m from there, or choose the smoother.")


class SampleBuffer:
    """Rows (12,) in order of time, `first <= i < stop`, in chunks: a long walk is never copied while it grows."""

    def __init__(self) -> None:
        self.skip_to(0)

    def skip_to(self, first: int) -> None:
        """Begin at a row, where none is there yet: those before it were discarded."""
        self.first = self.stop = first
        self._chunks = [np.full((CHUNK, TAKEN), -np.inf)] if first % CHUNK else []

    def append(self, rows: Floats) -> None:
        """Append rows (n, 12), or (n, 11) of which none is bad; field and pressure may be NaN, stamps rise."""
        while len(rows):
            used = self.stop % CHUNK
            if used == 0:
                self._chunks.append(np.zeros((CHUNK, TAKEN)))
            taken = min(CHUNK - used, len(rows))
            self._chunks[-1][used : used + taken, : rows.shape[1]] = rows[:taken]
            self.stop += taken
            rows = rows[taken:]

    def between(self, start: int, stop: int) -> Floats:
        """Return a copy (stop - start, 12) of the rows `start <= i < stop`, none of which was discarded."""
        pieces = [np.empty((0, TAKEN))]
        for number in range(start // CHUNK, -(-stop // CHUNK)):
            offset = number * CHUNK
            pieces.append(self._chunk(number)[max(start - offset, 0) : min(stop - offset, CHUNK)])
        return np.concatenate(pieces)

    def stamp(self, sample: int) -> float:
        """Return the stamp of a sample, s."""
        return float(self._chunk(sample // CHUNK)[sample % CHUNK, 0])

    @property
    def newest_s(self) -> float:
        """Stamp of the newest sample, s; -inf before the first."""
        return self.stamp(self.stop - 1) if self.stop > self.first else -np.inf

    def find_since(self, t: float, stop: int) -> int:
        """Return the first sample in [`first`, `stop`) with a stamp of t (s) or later; `stop` if there is none."""
        number = (stop - 1) // CHUNK
        while number * CHUNK > self.first and self._chunk(number)[0, 0] >= t:
            number -= 1
        stamps = self._chunk(number)[: stop - number * CHUNK, 0]
        at = number * CHUNK + int(np.searchsorted(stamps, t))
        return max(at, self.first)

    def discard(self, before: int) -> None:
        """Discard rows `i < before`, and give back their memory."""
        first = max(self.first, min(before, self.stop))
        self._chunks = self._chunks[first // CHUNK - self.first // CHUNK :]
        self.first = first

    def _chunk(self, number: int) -> Floats:
        return self._chunks[number - self.first // CHUNK]


class Pace:
    """How long a walk, or that of two feet, waited for samples so far: the time between two blocks of them."""

    def __init__(self) -> None:
        self.idle_s, self._left = 0.0, time.monotonic()

    def __enter__(self) -> None:
        self.idle_s += time.monotonic() - self._left

    def __exit__(self, *_: object) -> None:
        self._left = time.monotonic()


@dataclass(frozen=True)
class KnownMagnetometer:
    """The magnetometer of a walk so far: its delay, wrong axes, whether it is used, and notes on these."""

    delay: MagnetometerDelay | None
    wrong_axes: MagAxes | None
    used: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class SensorState:
    """Sensor parameters estimated on the walk so far."""

    extreme: Floats  # (2, 2, 3) largest readings so far: force and rate, upper and lower end.
    period_s: float | None = None  # None before the walk was cut out as a whole.
    clipping: tuple[Floats, Floats] | None = None  # Levels of specific force and rate at which it clips, (2, 3) each.
    peak_height: float = 1.0  # Of clipped peaks of the rate above the range, in units of what their flanks show.
    magnetometer: KnownMagnetometer | None = None  # None before it was examined.
    iron: MagnetometerCalibration | None = None  # Of the last solution; None where it showed none.


UNSEEN = SensorState(np.zeros((2, 2, 3)))  # Of a walk that has not begun.


@dataclass(frozen=True)
class ReportedFootfall:
    """A footfall of a walk in progress."""

    footfall: Footfall
    line: int  # Number of its line, -1 where there was none.
    until: int  # The samples before this one came with it.


class PartialWalk:
    """Footfalls from number `first` on, those before discarded, and the samples before `stop` up to them."""

    def __init__(
        self,
        buffer: SampleBuffer,
        options: OnlineOptions = OnlineOptions(),
        first: int = 0,
        footfalls: Sequence[ReportedFootfall] = (),
        sensor: SensorState = UNSEEN,
    ) -> None:
        self.buffer, self._options = buffer, options
        self.discarded, self._footfalls = first, list(footfalls)
        self.stop = footfalls[-1].until if footfalls else 0
        self.sensor = sensor

    @property
    def continues(self) -> Bools:
        """(F,) which footfalls that were not discarded are further pieces of a standing."""
        return np.array([one.footfall.continues for one in self._footfalls], dtype=np.bool_)

    def footfall(self, number: int) -> Footfall:
        """Return a footfall that was not discarded."""
        return self._footfalls[number - self.discarded].footfall

    def footfalls_since(self, number: int) -> tuple[ReportedFootfall, ...]:
        """Return the footfalls from `number` on, which was not discarded."""
        return tuple(self._footfalls[number - self.discarded :])

    def replace_footfalls(self, number: int, footfalls: Sequence[ReportedFootfall]) -> None:
        """Replace the footfalls from `number` on."""
        self._footfalls[max(number - self.discarded, 0) :] = footfalls[max(self.discarded - number, 0) :]
        self.stop = self._footfalls[-1].until

    def add(self, footfall: ReportedFootfall) -> None:
        """Append a footfall, and the samples of the buffer up to one before its `until`.

        Raises `EstimationError` with samples that are not finite or out of order, or a footfall that is not among them.
        """
        rows = self.buffer.between(max(self.stop - 1, self.buffer.first), footfall.until)
        begins = int(self._footfalls[-1].footfall.stop[-1]) if self._footfalls else 0
        one, number = footfall.footfall, self.discarded + len(self._footfalls)
        # Its stances follow each other, the stillest sample within them.
        rise = np.diff([begins, *np.stack([one.start, one.stop], axis=1).ravel(), footfall.until])
        is_in_one = ((one.start <= one.stillest) & (one.stillest < one.stop)).any()
        if not (is_in_one and (rise >= 0).all() and (rise[1::2] > 0).all()):
            raise EstimationError(
                f"footfall {number} is not one: its stances must follow those before, within the samples, and the "
                "stillest sample must be in one of them."
            )
        if not np.isfinite(rows[:, :7]).all() or not (np.diff(rows[:, 0]) > 0).all():
            raise EstimationError(
                f"samples of footfall {number} are not finite, or their stamps do not rise: leave them out."
            )
        ends = rows[:, 1:7].max(axis=0, initial=0.0), -rows[:, 1:7].min(axis=0, initial=0.0)
        extreme = np.stack(ends).reshape(2, 2, 3).swapaxes(0, 1)
        self.sensor = replace(self.sensor, extreme=np.maximum(self.sensor.extreme, extreme))
        self.stop = footfall.until
        self._footfalls.append(footfall)

    def discard(self, footfalls: int, samples: int) -> None:
        """Discard the footfalls before number `footfalls`, and the samples before number `samples`."""
        self._footfalls = self._footfalls[max(footfalls - self.discarded, 0) :]
        self.discarded = max(self.discarded, footfalls)
        self.buffer.discard(samples)

    def align_magnetometer(self) -> None:
        """Find delay and axes of the magnetometer on all samples, unless its delay is known well."""
        found = self.sensor.magnetometer
        is_settled = found is not None and found.delay is not None and found.delay.sigma_s <= SETTLED_S
        if not self._options.use_field or is_settled:
            return
        aligned = align_magnetometer(self._cut(self.buffer.first, self.stop), self._options.axes_given)
        used = aligned.recording.mag is not None
        known = KnownMagnetometer(aligned.delay, aligned.wrong_axes, used, aligned.notes)
        self.sensor = replace(self.sensor, magnetometer=known)

    def cut_whole(self) -> Recording:
        """Return all samples, iron not corrected; note their period and clipping levels in `sensor`."""
        recording = self._cut_aligned(self.buffer.first, self.buffer.first)
        self.sensor = replace(self.sensor, period_s=recording.period_s, clipping=recording.clipping)
        return recording

    def cut_recording(self, first: int, mag_from: int | None = None) -> Recording:
        """Return the samples from `first` on, with the field from `mag_from` on, NaN before; None for all."""
        part = self._of_sensor(self._cut_aligned(first, first if mag_from is None else mag_from))
        iron = self.sensor.iron
        return part if iron is None or part.mag is None else iron.apply_to(part)

    def cut_stances(self, first_footfall: int, first: int) -> Stances:
        """Return the stances from `first_footfall` on, in samples from number `first` on.

        Each piece of a long standing is a footfall of its own. The statistic is 0 at the stillest samples, else 1.
        """
        footfalls = [one.footfall for one in self._footfalls[first_footfall - self.discarded :]]
        number = np.repeat(np.arange(len(footfalls)), [len(one.start) for one in footfalls])
        start = np.concatenate([one.start for one in footfalls]) - first
        end = np.concatenate([one.stop for one in footfalls]) - first
        statistic = np.ones(self.stop - first)
        statistic[np.array([one.stillest for one in footfalls]) - first] = 0.0
        return Stances(start, end, number, n_samples=self.stop - first, statistic=statistic)

    def cut_onward(self, sample: int, until: int) -> tuple[Recording, int]:
        """Return the recording from `SAMPLES_BEFORE` before `sample` to `until`, and the index of `sample` in it."""
        first = max(sample - SAMPLES_BEFORE, self.buffer.first)
        return self._of_sensor(self._cut(first, until)), sample - first

    def _cut_aligned(self, first: int, mag_from: int) -> Recording:
        """Return samples from `first` on, with the field from `mag_from` on, its delay removed; NaN before."""
        recording, found = self._cut(first, self.stop), self.sensor.magnetometer
        if found is None:
            return recording
        if not found.used:
            return replace(recording, mag=None)
        lead = self.buffer.find_since(self.buffer.stamp(mag_from) - LEAD_S, mag_from)
        part = recording if lead == first else self._cut(lead, self.stop)
        mag = part.mag if found.delay is None else remove_delay(part, found.delay).mag
        if mag is None:
            return recording
        unseen = np.full((mag_from - first, 3), np.nan)
        return replace(recording, mag=np.concatenate([unseen, mag[mag_from - lead :]]))

    def _cut(self, first: int, stop: int) -> Recording:
        return as_recording(self.buffer.between(first, stop), self._options.use_field)

    def _of_sensor(self, part: Recording) -> Recording:
        """Return a part with period and clipping levels of the whole walk, clipped peaks raised by `peak_height`.

        Where the whole had not clipped yet: at its own levels, if they are at the end of all readings so far.
        """
        sensor = self.sensor
        if sensor.period_s is None or sensor.clipping is None:
            return part
        levels = sensor.clipping[0].copy(), sensor.clipping[1].copy()
        for samples, level, extreme in zip((part.acc, part.gyr), levels, sensor.extreme, strict=True):
            # Only where a part reaches the end can its level be that of the range.
            ends = np.array([samples.max(axis=0), -samples.min(axis=0)])
            for end, axis in np.argwhere((ends >= AT_END * extreme) & ~np.isfinite(level)):
                own = find_saturation_level((1.0 - 2.0 * end) * samples[:, axis])
                if own >= AT_END * extreme[end, axis]:
                    level[end, axis] = own
        return part.assume(sensor.period_s, levels).raise_peaks(sensor.peak_height)


def as_recording(rows: Floats, with_mag: bool = True) -> Recording:
    """Return rows (n, 12) as a recording."""
    bad = rows[:, COLUMNS].astype(np.int64)
    mag = rows[:, 7:10] if with_mag else None
    pressure = rows[:, 10] if np.isfinite(rows[:, 10]).any() else None
    return Recording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], mag, unread=bad if bad.any() else None, pressure=pressure)


def taken_rows(recording: Recording) -> Floats:
    """Return the samples of a recording as rows (N, 12)."""
    bad = np.zeros(len(recording)) if recording.unread is None else recording.unread
    return np.column_stack([rows_of(recording), bad])


def rows_of(recording: Recording | RawRecording) -> Floats:
    """Return a recording's samples as rows (N, 11) of a stream; NaN for a sensor it lacks."""
    mag = np.full((len(recording.t), 3), np.nan) if recording.mag is None else recording.mag
    pressure = np.full(len(recording.t), np.nan) if recording.pressure is None else recording.pressure
    return np.column_stack([recording.t, recording.acc, recording.gyr, mag, pressure])
