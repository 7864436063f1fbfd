"""What a sensor on a walking person recorded.

Symbols and units (frames: see `fg_nav`)

====== ========= ======================================================================
t      s         (N,) stamps, strictly increasing
acc    m/s^2     (N, 3) specific force in the body frame: +g on the up axis at rest
gyr    rad/s     (N, 3) angular rate of the body in the body frame
mag    uT        (N, 3) magnetic flux density in the body frame; NaN rows where there is no new sample
pressure Pa      (N,) of the air; NaN where there is no new sample
unread -         (N,) of which sensor a sample was bad, `ACC_OUT` or `GYR_OUT`, else 0; None where none is
====== ========= ======================================================================

A `RawRecording` is what a file says, in SI units but unchecked; a `Recording` is what estimators accept.
`Recording.from_raw` is the one door between the two: what it mends and what it refuses is a table in docs/formats.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.columns.samples import ColumnNames, Samples, Units, check_shapes, convert_arrays, convert_frame
from fg_nav.errors import RecordingError
from fg_nav.samples import plausibility
from fg_nav.samples.gaps import Bridge, Gaps, bridge_unread, fill_gaps, prepare_samples
from fg_nav.samples.readings import (
    ACC_OUT,
    BOTH_OUT,
    GYR_OUT,
    Peaks,
    find_clipping_levels,
    find_mag_outliers,
    find_outliers,
    interpolate_unread,
    rebuild_peaks,
)
from fg_nav.samples.stamps import GAP_PERIODS, MAX_BRIDGED_S, MAX_GAP_S, find_lost_share, order_stamps, remove_jitter
from fg_nav.text import format_count, to_html
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth

if TYPE_CHECKING:
    import pandas as pd

NOMINAL_SIGMA = 0.02  # Of a nominal rate: makers allow 1 to 10 per cent.
MIN_SAMPLES = 20  # Fewer samples than this hold no stance and no stride.
MAX_MISSING_SHARE = 0.2  # Of scattered samples, beyond which their neighbours do not show what lies between.


@dataclass(frozen=True)
class Provenance:
    """Where a recording came from and what was done to it on the way in.

    Of `bad_samples` accelerometer or gyroscope was bad: left out where both were, else of that sensor bridged.
    `rate_sigma` is that of the sample rate, as a share of it, where the time is counted by a nominal one; else zero.
    So many as `cut_samples` are in parts of the file that a hole cut off.
    """

    path: Path | None = None
    format: str = "array"
    notes: tuple[str, ...] = ()
    bad_samples: int = 0
    rate_sigma: float = 0.0
    cut_samples: int = 0


@dataclass(frozen=True)
class RawRecording(Brief):
    """A file's samples in SI units, unchecked: stamps may repeat, run backward or be NaN; so may samples.

    `row` (N,) is the 1-based line (or array row) of each sample in its file, for messages.
    """

    t: Floats
    acc: Floats
    gyr: Floats
    row: Ints
    mag: Floats | None = None
    truth: Truth | None = None
    provenance: Provenance = field(default_factory=Provenance)
    pressure: Floats | None = None


@dataclass(frozen=True)
class Recording:
    """Samples an estimator can trust the shape of: finite acc and gyr, strictly increasing stamps.

    Raises `RecordingError` on wrong shapes, too few samples, non-finite samples or stamps that do not increase.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> recording.acc.shape == recording.gyr.shape == (len(recording), 3)  # m/s^2, rad/s
    True
    >>> recording
    <Recording: 4000 samples over 20.0 s at 200 Hz, with magnetometer>
    """

    t: Floats
    acc: Floats
    gyr: Floats
    mag: Floats | None = None
    truth: Truth | None = None
    provenance: Provenance = field(default_factory=Provenance)
    unread: Ints | None = None
    pressure: Floats | None = None

    def __post_init__(self) -> None:
        for name in ("t", "acc", "gyr", "mag", "pressure"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, np.ascontiguousarray(value, dtype=np.float64))
        check_shapes(self.t, self.acc, self.gyr, self.mag, self.pressure)
        _check_count(len(self.t))
        finite = np.isfinite(self.t) & np.isfinite(self.acc).all(axis=1) & np.isfinite(self.gyr).all(axis=1)
        if not finite.all():
            raise RecordingError(f"sample {np.argmin(finite)} is not finite: leave it out.")
        rising = np.diff(self.t) > 0
        if not rising.all():
            late = int(np.argmin(rising)) + 1
            raise RecordingError(f"the stamp of sample {late} is not after the one before: sort them.")

    @classmethod
    def from_raw(cls, raw: RawRecording, longest_gap_s: float = MAX_BRIDGED_S) -> Recording:
        """Judge a file's samples and take what can be navigated with (docs/formats.md).

        Omissions are noted in `provenance`. The recording is cut at a gap longer than `longest_gap_s`.

        Raises `RecordingError` if the recording is refused: what is wrong, at which row and time, and what to try.
        """
        try:
            return _admit(raw, longest_gap_s)
        except RecordingError as error:
            path = raw.provenance.path
            raise RecordingError(f"{path.name}: {error}" if path else str(error)) from None

    @classmethod
    def from_arrays(
        cls, t: ArrayLike, acc: ArrayLike, gyr: ArrayLike, mag: ArrayLike | None = None, units: Units = None
    ) -> Recording:
        """Judge stamps (N,) and vectors (N, 3) as `from_raw` does a file's; `units` as of `fg_nav.columns.samples`.

        >>> still = np.zeros((50, 3))
        >>> Recording.from_arrays(10.0 * np.arange(50), still + [0, 0, 1], still, units="ms, g, deg/s").duration_s
        0.49
        """
        return cls._from_samples(convert_arrays(t, acc, gyr, mag, units))

    @classmethod
    def from_dataframe(
        cls, df: pd.DataFrame, columns: ColumnNames = None, units: Units = None, rate_hz: float | None = None
    ) -> Recording:
        """Judge the columns of a data frame, found by their names or as `columns` maps them, as `from_raw` a file's.

        >>> df = pd.DataFrame({"t": np.arange(50), "ax": 0, "ay": 0, "az": 1.0, "gx": 0, "gy": 0, "gz": 90})
        >>> float(Recording.from_dataframe(df, units="ms, g, deg/s").gyr[0, 2].round(4))
        1.5708
        """
        return cls._from_samples(convert_frame(df, columns, units, rate_hz), rate_hz is not None)

    @classmethod
    def _from_samples(cls, own: Samples, is_nominal: bool = False) -> Recording:
        row, provenance = np.arange(1, len(own.t) + 1), Provenance(notes=own.notes)
        raw = RawRecording(own.t, own.acc, own.gyr, row, own.mag, provenance=provenance, pressure=own.pressure)
        return cls.from_raw(note_nominal_rate(raw) if is_nominal else raw)

    @cached_property
    def period_s(self) -> float:
        """Median sample period in seconds."""
        return float(np.median(np.diff(self.t)))

    @property
    def periods_s(self) -> Floats:
        """(N,) s, for which each sample is held: until the next stamp; the last one for the median period."""
        return np.append(np.diff(self.t), self.period_s)

    @cached_property
    def gaps(self) -> Gaps:
        """Where samples are missing, and what lies there as far as the recording shows."""
        return fill_gaps(self.t, self.acc, self.gyr)

    @cached_property
    def bridges(self) -> tuple[Bridge, Bridge]:
        """What accelerometer and gyroscope would have read where they are `unread`."""
        return bridge_unread(self.t, self.acc, self.gyr, self.unread)

    @cached_property
    def integrable(self) -> tuple[Floats, Floats]:
        """Specific force (N, 3) m/s^2 and rate (N, 3) rad/s for strapdown navigation (`fg_nav.samples.gaps`)."""
        acc, gyr = (bridge.put(peaks.whole) for bridge, peaks in zip(self.bridges, self.peaks, strict=True))
        return prepare_samples(acc, gyr, self.periods_s, self.gaps)

    @cached_property
    def peaks(self) -> tuple[Peaks, Peaks]:
        """Specific force and rate with the peaks rebuilt that the sensor cut."""
        acc, gyr = self.clipping
        return rebuild_peaks(self.acc, self.period_s, acc), rebuild_peaks(self.gyr, self.period_s, gyr)

    def raise_peaks(self, factor: float) -> Recording:
        """Return the same samples with this many times as much rebuilt of the rate above what was read."""
        if factor == 1.0:
            return self
        acc, gyr = self.peaks
        raised, peaks = replace(self), (acc, gyr._replace(whole=self.gyr + factor * (gyr.whole - self.gyr)))
        raised.__dict__.update({name: getattr(self, name) for name in ("period_s", "gaps", "bridges", "clipping")})
        raised.__dict__["peaks"] = peaks
        return raised

    @cached_property
    def clipping(self) -> tuple[Floats, Floats]:
        """Levels (2, 3) from which on specific force and rate are clipped, as in `fg_nav.samples.readings`."""
        return find_clipping_levels(self.acc), find_clipping_levels(self.gyr)

    def assume(self, period_s: float, clipping: tuple[Floats, Floats]) -> Recording:
        """Return the same samples with period and clipping of a longer recording of the same sensor."""
        same = replace(self)
        same.__dict__.update(period_s=period_s, clipping=clipping)
        return same

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp in seconds."""
        return float(self.t[-1] - self.t[0])

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        """Say in a line what it is; the samples are many."""
        parts = (("magnetometer", self.mag), ("barometer", self.pressure), ("truth", self.truth))
        known = [name for name, value in parts if value is not None]
        rate = f"{len(self)} samples over {self.duration_s:.1f} s at {1.0 / self.period_s:.0f} Hz"
        return f"<Recording: {rate}{', with ' if known else ''}{' and '.join(known)}>"

    def _repr_html_(self) -> str:
        """Show in a notebook what it is, and what was done to it on the way in."""
        known = self.provenance
        rows = [("samples", repr(self).partition(": ")[2].rstrip(">")), ("format", known.format)]
        rows += [("file", str(known.path))] if known.path else []
        return to_html("Recording", [*rows, *(("note", words) for words in known.notes)])

    def take(self, part: Bools | slice) -> Recording:
        """Return some of the samples; truth and provenance stay whole. Raises `RecordingError` if too few are left."""
        columns = {name: getattr(self, name) for name in ("t", "acc", "gyr", "mag", "unread", "pressure")}
        return replace(self, **{name: column[part] for name, column in columns.items() if column is not None})

    def slice(self, start: int, stop: int) -> Recording:
        """Cut out the samples `start <= i < stop`, as views; truth and provenance stay whole.

        Gaps and sub-sample motion are kept as estimated from the whole recording.
        """
        part = np.s_[start:stop]
        cut = self.take(part)
        acc, gyr = self.integrable
        cut.__dict__.update(
            gaps=self.gaps.within(start, stop),
            bridges=tuple(bridge.within(start, stop) for bridge in self.bridges),
            period_s=self.period_s,
            integrable=(acc[part], gyr[part]),
            peaks=tuple(Peaks(*(column[part] for column in peaks)) for peaks in self.peaks),
            clipping=self.clipping,
        )
        return cut


def note_nominal_rate(raw: RawRecording, sigma: float = NOMINAL_SIGMA) -> RawRecording:
    """Return the samples with the relative `sigma` of their nominal rate, widened by lost rows, and notes on it.

    A stride is force integrated twice, so its length goes with the square of the period.
    """
    notes = [f"the rate is nominal, known to {100 * sigma:.2g} %: 1 % of it is 2 % of the path"]
    lost = find_lost_share(raw.gyr)
    if lost > 0.0:
        notes.append(f"double steps of the gyroscope show that {100 * lost:.1f} % of the rows are lost")
    known = raw.provenance
    known = replace(known, notes=(*known.notes, *notes), rate_sigma=float(np.hypot(sigma, lost)))
    return replace(raw, provenance=known)


def _admit(raw: RawRecording, longest_gap_s: float) -> Recording:
    """Return the recording of a file's samples: units, missing samples, stamps, gaps, bad samples."""
    check_shapes(raw.t, raw.acc, raw.gyr, raw.mag, raw.pressure)
    _check_count(len(raw.t))
    # units and gravity; missing samples
    is_usable = plausibility.find_usable_samples(raw.t, raw.acc, raw.gyr)
    for problem in plausibility.find_lasting_problems(raw.t, raw.acc, raw.gyr, raw.mag, is_usable):
        raise RecordingError(f"{problem}.")
    usable = np.flatnonzero(is_usable)
    _check_count(len(usable))
    # stamps that repeat or fall
    found = order_stamps(raw.t[usable], np.hstack([raw.acc[usable], raw.gyr[usable]]), raw.row[usable], longest_gap_s)
    kept = usable[found.kept]
    _check_count(len(kept))
    missing = _judge_missing(raw, is_usable, int(kept.min()), int(kept.max()))
    notes = [*raw.provenance.notes, *missing, *found.remarks]
    # gaps: those bridged from the samples around them, or too long for that
    step = np.diff(found.t)
    worst = int(np.argmax(step))
    longest = f"the longest of {1e3 * step[worst]:.0f} ms before row {raw.row[kept[worst + 1]]}"
    gaps, unseen = int((step > GAP_PERIODS * np.median(step)).sum()), int((step > MAX_GAP_S).sum())
    if unseen:
        bridged = f"{format_count(unseen, 'gap')} of more than {MAX_GAP_S:g} s is bridged, {longest}"
        notes.append(f"{bridged}: heading and position behind it are less certain")
    elif gaps:
        notes.append(f"{format_count(gaps, 'gap')} of more than two samples, {longest}")
    # a sensor samples evenly, however its samples were stamped on the way
    t = remove_jitter(found.t)
    if not np.array_equal(t, found.t):
        notes.append(f"evened out the jitter of the stamps, up to {1e3 * float(np.abs(t - found.t).max()):.1f} ms")
    provenance = replace(raw.provenance, cut_samples=found.cut)
    raw = replace(raw, truth=_move_to_clock(raw.truth, raw.t[kept], t), provenance=provenance)
    return _leave_out_bad(raw, kept, t, notes)


def _leave_out_bad(raw: RawRecording, kept: Ints, t: Floats, notes: list[str]) -> Recording:
    """Return the recording of the samples `kept` (K,), at stamps `t` (K,) s, without the bad ones of each sensor."""
    # accelerometer and gyroscope: left out where both are bad, a line where one is
    bad = find_outliers(t, raw.acc[kept], raw.gyr[kept])
    found = [name for name, which in (("gyroscope", GYR_OUT), ("accelerometer", ACC_OUT)) if (bad & which).any()]
    notes = [*notes, *_note_bad(bad > 0, " and ".join(found), t, raw.row[kept])]
    good = bad != BOTH_OUT
    kept, t, unread = kept[good], t[good], bad[good]
    _check_count(len(kept))
    acc, gyr = raw.acc[kept], raw.gyr[kept]
    interpolate_unread(t, acc, gyr, unread)
    # magnetometer, whole rows only, and barometer
    mag = None if raw.mag is None else raw.mag[kept]
    if mag is not None:
        mag[~plausibility.find_field_samples(mag)] = np.nan
        mag = None if np.isnan(mag).all() else mag
    if mag is not None:
        bad_mag = find_mag_outliers(t, mag)
        mag[bad_mag] = np.nan
        notes += _note_bad(bad_mag, "magnetometer", t, raw.row[kept])
    pressure = None if raw.pressure is None else plausibility.keep_air(raw.pressure[kept])
    provenance = replace(raw.provenance, notes=tuple(notes), bad_samples=int(np.count_nonzero(bad)))
    return Recording(t, acc, gyr, mag, raw.truth, provenance, unread if unread.any() else None, pressure)


def _note_bad(bad: Bools, sensor: str, t: Floats, row: Ints) -> list[str]:
    """Return a note on the `bad` (K,) samples of a sensor; none where there is none."""
    if not bad.any():
        return []
    first, words = int(np.argmax(bad)), f"{format_count(int(bad.sum()), 'bad sample')} of the {sensor}"
    where = f"the first in row {row[first]} (t = {t[first]:.3f} s)"
    return [f"did not use {words}, far off what the samples around allow, {where}"]


def _move_to_clock(truth: Truth | None, stamped: Floats, t: Floats) -> Truth | None:
    """Return the truth with its times moved from the `stamped` (K,) s of the samples to the corrected `t` (K,) s."""
    if isinstance(truth, FootprintTruth) and truth.t is not None:
        # where the clock restarted one stamp belongs to two samples
        if (np.diff(truth.t) <= 0).any() or (np.diff(stamped) < 0).any():
            return replace(truth, t=None)
        return replace(truth, t=truth.t + np.interp(truth.t, stamped, t - stamped))
    if isinstance(truth, TrajectoryTruth) and np.array_equal(truth.t, stamped):
        return replace(truth, t=t)
    return truth


def _check_count(count: int) -> None:
    if count < MIN_SAMPLES:
        raise RecordingError(
            f"{format_count(count, 'usable sample')} cannot make a walk: record at least {MIN_SAMPLES}."
        )


def _judge_missing(raw: RawRecording, usable: Bools, first: int, last: int) -> list[str]:
    """Return a note on the missing samples; raise if too many lie between the used samples `first` and `last`."""
    missing = np.flatnonzero(~usable)
    if not len(missing):
        return []
    within = missing[(missing >= first) & (missing < last)]
    if len(within) > MAX_MISSING_SHARE * (last - first):
        t, row = raw.t[within[0]], raw.row[within[0]]
        raise RecordingError(
            f"{len(within)} of {last - first} samples are missing (empty, NaN or out of any range), the first in "
            f"row {row}{f' (t = {t:.3f} s)' if np.isfinite(t) else ''}: export the recording again."
        )
    return [f"left out {format_count(len(missing), 'missing sample')}, the first in row {raw.row[missing[0]]}"]


def find_extra_sigmas(recording: Recording, saturated_share: float) -> tuple[Floats, Floats]:
    """Return extra sigmas of single samples on top of the noise densities, (N, 3) m/s^2 and (N, 3) rad/s; mostly zero.

    Constant over the sample's own period, and axis by axis: a foot clips its pitch rate, and its heading need not
    suffer. A rebuilt peak has the sigma of that, and may hide a share of the range besides: `saturated_share`, 0 for no
    extra sigma of peaks. A sample before a gap has the sigma of what lies there times the share of the period that the
    gap fills, one that was bad of one sensor that of its bridge.
    """
    gaps = recording.gaps
    held_s = recording.t[gaps.sample + 1] - recording.t[gaps.sample]
    share = (gaps.unseen_s / held_s)[:, None]
    found = []
    sensors = (recording.acc, gaps.acc_sigma), (recording.gyr, gaps.gyr_sigma)
    for (samples, unseen), peaks, bridge in zip(sensors, recording.peaks, recording.bridges, strict=True):
        cut = np.flatnonzero(peaks.run.any(axis=1)) if saturated_share > 0 else gaps.sample[:0]
        if not (len(cut) or len(gaps.sample) or len(bridge.sample)):
            found.append(np.broadcast_to(0.0, samples.shape))  # takes no memory, and is not to be written to
            continue
        sigma = np.zeros(samples.shape)
        hidden = saturated_share * np.abs(samples[cut]) * np.sqrt(peaks.run[cut])
        sigma[cut] = np.hypot(peaks.sigma[cut], hidden)
        sigma[gaps.sample] = np.hypot(sigma[gaps.sample], share * unseen)
        sigma[bridge.sample] = np.hypot(sigma[bridge.sample], bridge.sigma)
        found.append(sigma)
    return found[0], found[1]
