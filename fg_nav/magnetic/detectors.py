r"""A detector of the quasi-static field: channels, a window, a form that makes one number of them, a threshold.

At footfall k the window holds the last N changes of each channel c (the N + 1 last footfalls; of a *zero*, the N last):
it ends at the footfall judged, so that a verdict never waits. With x the values, y the changes, all over sigma:

=============== ====================================================================== ==========================
form            statistic T                                                            source
=============== ====================================================================== ==========================
chi squared     sum_c sum_k (x_k - mean x)^2                 (a zero: sum_k x_k^2)      ours
sum of squares  (1/N) sum_c sum_k y_k^2                                                AIEZ Eq. 17; Afzal's QSF
squared sums    (1/N) sum_c (sum_k |y_k|)^2                                            Ma Eq. 26, absolutes as printed
=============== ====================================================================== ==========================

The field passes where T < threshold.

Why another form. Changes of values that scatter independently are correlated by -1/2 from one to the next (MA(1)), so
their squares do not add up to a chi squared: a sum of N of them has the variance of two values, not of 2 N. Testing
the values themselves for being one and the same does: T is chi squared with N degrees of freedom a channel, exactly,
while the field stands still. A slow change, missed by every single difference, is seen across the window.

Threshold. Ma's P_FA is the probability that a field passes which is *not* quasi-static. It needs a meaning of "not": a
channel's `matters`, the change spread evenly over the window that has to be rejected (of a zero: its lasting value).
T is then noncentral chi squared with

    lambda = min over channels of (matters / sigma)^2 s,   s = sum_j (j/N - 1/2)^2 = (N + 1)(N + 2) / (12 N);
                                                           of a zero, s = N;

and the threshold its quantile at the false-alarm rate; P_D, the share of static fields that pass, follows. Ma's Eq. 23
for P_FA cannot be computed: the density it integrates has the estimate of the very data in it.

These rates are those of the channels' own sigmas. Where a footfall's is greater (the standard error of a short stance's
slope, the drift of an inertial heading in the test of a heading offset), P_D is the same and more of what matters
passes than the false-alarm rate says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from scipy.stats import chi2, ncx2

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import MagneticError
from fg_nav.magnetic.channels import OFFSET, Channel

Form: TypeAlias = Literal["chi squared", "sum of squares", "squared sums"]
FORMS: tuple[Form, ...] = get_args(Form)


@dataclass(frozen=True)
class Laying:
    """How the inertial heading is laid on the compass, and how far the test trusts it; for a heading offset only.

    Their difference is followed by a scalar Kalman filter: begun with the mean of the first footfalls, corrected at
    each footfall that passes, and left alone where the field is rejected. Two limits follow. A walk that begins in a
    field that is wrong is judged by that field. And while the field is rejected the test widens with the drift, so that
    a lasting deviation is believed in the end: the sooner, the less it exceeds what matters.

    Attributes
    ----------
    first : footfalls that begin it, which are not judged; 0 where the inertial heading is known and counted from
        magnetic north, for the laying begins with no offset and no doubt of it.
    drift : rad/sqrt(s), random walk of the inertial heading. 0.2 deg after 1 s is 1.5 deg after a minute: more than the
        gyroscopes of the simulated walks drift, whose bias a rest has told.
    in_test : test against S = P + sigma^2 (a Kalman filter's innovation); False for sigma^2 alone, as AIEZ prints it,
        which rejects for ever once the drift exceeds sqrt(threshold) sigma.
    """

    first: int = 3
    drift: float = float(np.deg2rad(0.2))
    in_test: bool = True


@dataclass(frozen=True)
class Detector:
    """A detector of the quasi-static field.

    Attributes
    ----------
    name : for people and for `DETECTORS`.
    channels : at least one.
    form : how they become one statistic.
    window : N, changes from footfall to footfall that are looked at; for zeros alone, footfalls.
    false_alarm_rate : of a field that changes by what matters; not used where a threshold is fixed.
    fixed_threshold : of the statistic, or None for that of the false-alarm rate.
    laying : of a heading offset.
    """

    name: str
    channels: tuple[Channel, ...]
    form: Form = "chi squared"
    window: int = 3
    false_alarm_rate: float = 0.05
    fixed_threshold: float | None = None
    laying: Laying = Laying()

    def __post_init__(self) -> None:
        if not self.channels:
            raise MagneticError(f"detector '{self.name}' has no channel: give it at least one.")
        if self.form not in FORMS:
            raise MagneticError(f"there is no form '{self.form}' of a detector: choose one of {', '.join(FORMS)}.")
        if self.window < 1:
            raise MagneticError(f"the window of detector '{self.name}' must be at least 1, not {self.window}.")
        if not 0.0 < self.false_alarm_rate < 1.0:
            raise MagneticError(f"a false-alarm rate must be between 0 and 1, not {self.false_alarm_rate}.")
        if self.fixed_threshold is not None and not self.fixed_threshold > 0.0:
            raise MagneticError(f"the threshold of a detector must be positive, not {self.fixed_threshold}.")

    def with_false_alarm_rate(self, rate: float) -> Detector:
        """Return the same detector with the threshold of this false-alarm rate; chi squared only."""
        return replace(self, false_alarm_rate=rate, fixed_threshold=None)

    def with_threshold(self, threshold: float) -> Detector:
        """Return the same detector with this threshold."""
        return replace(self, fixed_threshold=threshold)

    def with_window(self, window: int) -> Detector:
        """Return the same detector with a window of so many changes; a fixed threshold stays what it is."""
        return replace(self, window=window)

    @property
    def changing(self) -> Bools:
        """(C,) True for channels that are values, False for zeros."""
        return np.array([channel.signal.value for channel in self.channels])

    @property
    def rows(self) -> int:
        """Footfalls that a verdict looks at."""
        return self.window + bool(self.changing.any())

    @property
    def offset_column(self) -> int | None:
        """Which channel is the heading offset."""
        return next((c for c, channel in enumerate(self.channels) if channel.name == OFFSET), None)

    @property
    def spent(self) -> int:
        """Footfalls that only begin the laying of a heading offset, and are not judged."""
        return 0 if self.offset_column is None else self.laying.first

    @property
    def degrees_of_freedom(self) -> int:
        """Of the statistic under a static field; chi squared only."""
        return self.window * len(self.channels)

    @property
    def noncentrality(self) -> float:
        """Of the statistic under the least change that matters, in the channel in which it is seen worst."""
        spread = (self.window + 1) * (self.window + 2) / (12 * self.window)
        return min((c.matters / c.sigma) ** 2 * (spread if c.signal.value else self.window) for c in self.channels)

    @property
    def threshold(self) -> float:
        """Of the statistic.

        Raises
        ------
        MagneticError
            Where none is fixed, for a form that is not chi squared or a channel that does not say what matters.
        """
        if self.fixed_threshold is not None:
            return self.fixed_threshold
        self._must_be_chi_squared()
        if not np.isfinite(self.noncentrality):
            raise MagneticError(f"detector '{self.name}' does not say which changes matter: fix its threshold.")
        return float(ncx2.ppf(self.false_alarm_rate, self.degrees_of_freedom, self.noncentrality))

    @property
    def detection_rate(self) -> float:
        """P_D, the share of static fields that pass; raises `MagneticError` for a form that is not chi squared."""
        self._must_be_chi_squared()
        return float(chi2.cdf(self.threshold, self.degrees_of_freedom))

    def _must_be_chi_squared(self) -> None:
        if self.form != "chi squared":
            raise MagneticError(
                f"the form '{self.form}' of detector '{self.name}' has no distribution to take a rate from: "
                "fix its threshold, or choose 'chi squared'."
            )

    def statistic(self, window: Floats) -> Floats:
        """T (...,) of windows (..., C, rows) of the channels' values over their sigmas, angles unwrapped."""
        return np.asarray(self.parts(window).sum(axis=-1))

    def parts(self, window: Floats) -> Floats:
        """(..., C) what each channel adds to T; `window` as in `statistic`."""
        latest = window[..., -self.window :]
        if self.form == "chi squared":
            about_mean = window - window.mean(axis=-1, keepdims=True)
            return np.asarray(np.where(self.changing, (about_mean**2).sum(axis=-1), (latest**2).sum(axis=-1)))
        change = np.where(self.changing[:, None], np.diff(latest, axis=-1, prepend=window[..., :1]), latest)
        sums = (change**2).sum(axis=-1) if self.form == "sum of squares" else np.abs(change).sum(axis=-1) ** 2
        return np.asarray(sums / self.window)
