"""The readings of a magnetometer along each stride, from one footfall to the next, with the sensor's inertial motion.

A stride has `PHASES` readings: the one at the footfall's stillest sample, and the others evenly over the swing that
follows, each the measured one that is nearest. Only swings of `MAX_SWING_S` count: between others the walker stood.

The attitude is given, or that of the gyroscope held upright by the stances (`fg_nav.magnetic.footfall_field`). Places
follow from it and the specific force, with no velocity at the footfalls: good to a few percent of the way, which is
enough to say which strides passed the same place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.footfall_field import integrate_attitude
from fg_nav.recording import Recording
from fg_nav.stances import Stances

PHASES = 16  # Readings of a stride: one every 5 cm of the way of a foot at the usual pace.
MAX_SWING_S = 2.0  # Beyond it the foot did not swing but stood where no stance was found.
FARTHEST_S = 0.1  # From the instant of a phase to its reading: a magnetometer of 10 Hz has one in every such time.


@dataclass(frozen=True)
class StrideReadings:
    """S strides of a walk, in order, over a recording of N samples.

    ========== ============ ========================================================================================
    t          (N,)         s
    nav_R_body (N, 3, 3)    inertial attitude; its heading drifts
    rate       (N, 3)       rad/s, of the gyroscope
    sample     (S, P)       of each reading; the first of each stride is that of the footfall
    reading    (S, P, 3)    uT, body frame, not calibrated
    place      (S, P, 3)    m, nav, as the inertial attitude has it
    ========== ============ ========================================================================================
    """

    t: Floats
    nav_R_body: Floats
    rate: Floats
    sample: Ints
    reading: Floats
    place: Floats

    def __len__(self) -> int:
        return len(self.sample)

    @property
    def start_s(self) -> Floats:
        """(S,) of each stride."""
        return np.asarray(self.t[self.sample[:, 0]])

    @property
    def standing_R(self) -> Floats:
        """Attitude (S, 3, 3) at the footfalls."""
        return np.asarray(self.nav_R_body[self.sample[:, 0]])

    def part(self, chosen: Bools) -> StrideReadings:
        """Some of the strides (S,)."""
        return replace(self, sample=self.sample[chosen], reading=self.reading[chosen], place=self.place[chosen])

    def motion_before(self, delay_s: float) -> tuple[Floats, Floats]:
        """Attitude (S, P, 3, 3) and rate (S, P, 3) that much before the samples, when late readings were measured."""
        t = self.t[self.sample] - delay_s
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        since = np.clip(t - self.t[i], 0.0, self.t[i + 1] - self.t[i])[..., None]
        turn = Rotation.from_rotvec((self.rate[i] * since).reshape(-1, 3)).as_matrix()
        return self.nav_R_body[i] @ turn.reshape(*i.shape, 3, 3), self.rate[i]


def read_strides(recording: Recording, stances: Stances, nav_R_body: Floats | None = None) -> StrideReadings:
    """Take the readings of each stride.

    Parameters
    ----------
    recording : with a magnetometer, not calibrated.
    stances : of that recording.
    nav_R_body : (N, 3, 3), the attitude to use; None for that of the gyroscope and the stances.

    Raises
    ------
    MagneticError
        Without a magnetometer, or if it never measures.
    EstimationError
        Without a stance, or with stances of another recording.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    if not len(measured):
        raise MagneticError("no sample of the magnetometer is a number: is it recorded?")
    attitude = integrate_attitude(recording, stances) if nav_R_body is None else nav_R_body
    footfall = stances.stillest(recording.gyr)
    wanted, lasts_s = _choose_phases(recording.t, stances, footfall)
    sample = _find_nearest(measured, wanted)
    off_s = np.abs(recording.t[sample] - recording.t[wanted.astype(np.int64)]).max(axis=1, initial=0.0)
    kept = (lasts_s < MAX_SWING_S) & (off_s < FARTHEST_S)
    place = integrate_places(recording, attitude, footfall)
    sample = sample[kept]
    return StrideReadings(recording.t, attitude, recording.gyr, sample, recording.mag[sample], place[sample])


def _choose_phases(t: Floats, stances: Stances, footfall: Ints) -> tuple[Floats, Floats]:
    """Where (S, P) in samples the phases are, and how long (S,) s the swings last."""
    arrives, leaves = stances.spans
    begin, end = leaves[:-1] - 1, arrives[1:]
    swing = begin[:, None] + (end - begin)[:, None] * np.linspace(0.0, 1.0, PHASES - 1)
    return np.column_stack([footfall[:-1], swing]), t[end] - t[begin]


def _find_nearest(measured: Ints, wanted: Floats) -> Ints:
    after = np.clip(np.searchsorted(measured, wanted), 1, max(len(measured) - 1, 1))
    low, high = measured[after - 1], measured[np.minimum(after, len(measured) - 1)]
    return np.where(wanted - low < high - wanted, low, high)


def integrate_places(recording: Recording, nav_R_body: Floats, footfall: Ints) -> Floats:
    """Places (N, 3) m by the specific force twice integrated, the velocity being zero at the footfalls (F,)."""
    step = np.diff(recording.t, append=recording.t[-1])[:, None]
    force = np.einsum("nij,nj->ni", nav_R_body, recording.acc) - [0.0, 0.0, GRAVITY_M_S2]
    velocity = np.cumsum(force * step, axis=0)
    samples = np.arange(len(velocity))
    false = np.stack([np.interp(samples, footfall, axis[footfall]) for axis in velocity.T], axis=1)
    moves = (samples >= footfall[0]) & (samples <= footfall[-1])
    return np.cumsum(np.where(moves[:, None], velocity - false, 0.0) * step, axis=0)
