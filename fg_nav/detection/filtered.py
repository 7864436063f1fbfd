"""Did the sensor filter its samples? A low-pass that no walk has, and a high-pass of the gyroscope.

A heel strike has power up to a hundred hertz, and a foot in the air some up to 12. With P the power of the specific
force in a band, P(1 to 4 Hz) over P(8 to 12 Hz) is 2 to 25 on real feet, and 600 behind a low-pass of 5 Hz, which takes
the stances with it.

A high-pass of time constant 1 / k makes of the rate w the output y with y' = w' - k y: what it has taken off is

    w - y = k int y dt

so a turn seems to go back within 1 / k, and a constant rate is none. Gravity shows it. From one stance to the next,
with C the turn by y, the vertical misses what was taken off, and what a constant bias b adds:

    u_(j+1) - C^T u_j = u_(j+1) x (k int int y dt dt + b T)

k and b are those of least squares, with Student weights, and the evidence for k is by how much it lowers the log of the
misses, two to a stride, over b alone. On real sensors k is 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.handedness import DECISIVE, LOOKED_S, find_stance_strides
from fg_nav.errors import RecordingError
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.stances import Stances

GAIT_HZ, STRIKE_HZ = (1.0, 4.0), (8.0, 12.0)
MIN_SMOOTHING_HZ = 30.0  # A slower recording does not show the strikes.
SPECTRUM_S = 4.0  # Pieces of which the power is averaged.
UP_S = 0.05  # Around the stillest sample, in which the specific force points up.
MIN_STRIDES = 12  # Four unknowns want more strides.


def measure_smoothing(recording: Recording) -> float:
    """Power of the specific force at the gait's rate over that of heel strikes; NaN where too slow or short for it."""
    if recording.period_s > 1.0 / MIN_SMOOTHING_HZ or recording.duration_s < SPECTRUM_S:
        return np.nan
    acc = recording.acc[: round(LOOKED_S / recording.period_s)]
    length = round(SPECTRUM_S / recording.period_s)
    pieces = acc[: len(acc) // length * length].reshape(-1, length, 3)
    window = np.hanning(length)[:, None]
    power = np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    f, power = np.fft.rfftfreq(length, recording.period_s), power.sum(axis=(0, 2))
    of_gait, of_strike = (power[(f >= low) & (f < high)].mean() for low, high in (GAIT_HZ, STRIKE_HZ))
    return float(of_gait / max(of_strike, 1e-30))


class HighPass(NamedTuple):
    """A high-pass of the gyroscope: k, 1/s, and the evidence for it, nats; a filter that adds is none."""

    rate: float
    evidence: float

    @property
    def problem(self) -> str:
        """What is wrong with the gyroscope, in words, and what to do."""
        return (
            "the sensor has a high-pass on its gyroscope: a turn is taken back within "
            f"{1 / max(self.rate, 1e-9):.0f} s, as gravity shows, so no heading can be had of it: switch it off and "
            "record again"
        )


def refuse_high_pass(recording: Recording, stances: Stances) -> None:
    """Raise `RecordingError` where strides surely show a high-pass of the gyroscope."""
    found = measure_high_pass(recording, stances)
    if found.evidence > 2 * DECISIVE:
        raise RecordingError(f"{found.problem}.")


def measure_high_pass(recording: Recording, stances: Stances) -> HighPass:
    """Find the high-pass that strides show; no evidence where there are too few."""
    start, stop = find_stance_strides(recording, stances)
    if len(start) < MIN_STRIDES:
        return HighPass(0.0, 0.0)
    n = int(np.searchsorted(recording.t, recording.t[0] + LOOKED_S))
    t, acc, gyr = recording.t[:n], recording.acc[:n], recording.gyr[:n]
    h = np.append(np.diff(t), recording.period_s)
    # up in the body, and where the gyroscope takes it
    reach = max(1, round(UP_S / recording.period_s))
    force = np.vstack([np.zeros(3), np.cumsum(acc, axis=0)])
    before, up = (force[np.minimum(at + reach + 1, n)] - force[np.maximum(at - reach, 0)] for at in (start, stop))
    before, up = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (before, up))
    turn, none = np.tile(np.eye(3), (len(start), 1, 1)), np.zeros((len(start), 3))
    integrate_strides(acc, gyr, h, start, stop, turn, none, 0.0)
    miss = up - np.einsum("kji,kj->ki", turn, before)
    # what a high-pass and a bias make of it
    taken = np.cumsum(np.cumsum((gyr - gyr.mean(axis=0)) * h[:, None], axis=0) * h[:, None], axis=0)
    lasts = (t[stop] - t[start])[:, None]
    columns = [taken[stop] - taken[start], *(lasts * one for one in np.eye(3))]
    design = np.stack([np.cross(up, column) for column in columns], axis=2)
    weight = np.ones(len(start))
    for _ in range(10):
        found = _solve(design, miss, weight)
        left = np.sum((miss - design @ found) ** 2, axis=1)
        weight = 1.0 / (1.0 + left / (4.0 * max(float(np.median(left)), 1e-30)))
    without = np.sum((miss - design[:, :, 1:] @ _solve(design[:, :, 1:], miss, weight)) ** 2, axis=1)
    gain = len(start) * np.log(max(float(weight @ without), 1e-30) / max(float(weight @ left), 1e-30))
    return HighPass(float(found[0]), float(gain) if found[0] > 0.0 else 0.0)


def _solve(design: Floats, miss: Floats, weight: Floats) -> Floats:
    root = np.sqrt(weight)[:, None]
    rows = (root[..., None] * design).reshape(-1, design.shape[2])
    return np.asarray(np.linalg.lstsq(rows, (root * miss).ravel(), rcond=None)[0])
