"""The part of a path's field that repeats, with equal weight to all its wavelengths.

Symbols: field b (K, 3) uT along, left and up (`signature`), heading psi of the path, wave number k (1/m) along the
path.

Earth and iron. What is the same everywhere says nothing about a place. In nav that is the Earth's field e, which slowly
turns as the path's heading drifts; in the walking frame the iron h of shoe and sensor:

    b(d) = Rot(-psi(d)) e(d) + h + deviation(d),

e the mean in nav over `EARTH_M`, h that of the walk, found in turns.

Sources. Over distances the potential of sources below the path falls off upward, that of sources above it downward. In
two dimensions (nothing changes to the left) a wave of sources below has B_along = a sin(kd), B_up = a cos(kd): with the
Hilbert transform H along the path up = -H[along], of sources above up = +H[along] (Nabighian 1972). So

    below = (up - H[along]) / sqrt 2,    left,    above = (up + H[along]) / sqrt 2

are three components without correlation, where along and up are one signal seen twice (quadrature -0.8 to -0.95 on
simulated floors and on the phones of `magnetic_paths`). Their signs in the opposite direction of walking are +, -, +.

Whitening. The deviation has most power at long wavelengths: plain correlation would be decided by one or two of its
waves. With its spectrum S(k), Welch's over the walk, and that of what two readings at one place differ by, N, the
filter

    W(k) = band(k) / sqrt(S(k) + N)

gives all wavelengths in the band the same weight, which is what their likelihood ratio asks for (Whittle 1953). The
band is from `MAX_M`, beyond which drift and the Earth are, to `MIN_M`, below which passes that lie some
decimeters aside of each other do not repeat, and where the height of a swinging foot shows.

Scale. The result x is divided by its own rms a(d) over `LOCAL_M`: a quiet corridor compares as a rough one does,
and one large object does not decide. Of a^2 the share q = 1 - n^2 / a^2 is the field's, n^2 being N's part; where it
is small a quiet place resembles any other quiet one, and says nothing. A deviation beyond `MAX_SIGMAS` robust ones, as
within a hand's breadth of iron, counts as if it were there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats
from fg_nav.places.signature import BLOCK, SPACING_M, Signature

Complexes: TypeAlias = NDArray[np.complex128]

EARTH_M = 80.0
"""Over which the Earth's field is averaged: many objects, and a heading that has drifted by a few degrees."""

ROUNDS = 3  # In which Earth and iron are found in turns.

MAX_M, MIN_M = 20.0, 2.0
"""Band of wavelengths: full from the one to 1.25 of the other, and none at half of it beyond (cosine edges)."""

REPEATABILITY_UT = 0.5  # By which two readings of one place differ at each point: noise, and tilt (0.5 deg of 50 uT).
LOCAL_M = 25.0  # Over which the scale is taken: several of the wavelengths.
TINY = 1e-12  # Keeps a field that is the same everywhere from a division by zero.
MAD_TO_SIGMA = 1.4826  # Median absolute deviation to standard deviation, of a normal distribution.
SEGMENT = 64  # Points (32 m) of Welch's segments.
MAX_SIGMAS = 5.0  # Of deviations: normal ones do not come near.
MIN_SIGNAL = 0.02  # q below which there is none.


@dataclass(frozen=True)
class Features:
    """Of K points: `values` (K, 3), below, left and above, of unit variance, and `signal` (K, 3), their sqrt(q)."""

    values: Floats
    signal: Floats

    def __len__(self) -> int:
        return len(self.values)

    def reverse(self) -> Features:
        """Return those of the path walked in the opposite direction."""
        return Features(np.ascontiguousarray(self.values[::-1] * REVERSED), np.ascontiguousarray(self.signal[::-1]))

    def negate(self) -> Features:
        """Return those of the opposite field: of no place of this walk, but as rough, and with all it has in common."""
        return Features(-self.values, self.signal)


REVERSED = np.array([1.0, -1.0, 1.0])  # Signs of below, left, above in the opposite direction of walking.
TURNED = np.array([-1.0, -1.0, 1.0])  # Signs of along, left, up there.


def whiten(path: Signature, like: Signature | None = None) -> Features:
    """Separate, filter and scale the field of a path; the filter is of its own spectra, or of those of `like`."""
    spectrum = _transform(path)
    parts = _invert(spectrum, len(path)) if like is None else _invert(_transform(like), len(like))
    gain = _gains(parts, np.asarray(np.fft.rfftfreq(2 * len(path), SPACING_M), dtype=np.float64))
    values = _invert(spectrum * gain, len(path))
    # To the same scale everywhere, of which the field has a share.
    power = _smooth(values**2, LOCAL_M) + TINY
    signal = 1.0 - REPEATABILITY_UT**2 * np.mean(gain**2, axis=0) / power
    signal = np.where((signal > MIN_SIGNAL) & path.seen[:, None], signal, 0.0)
    return _pad(Features(values / np.sqrt(power), np.sqrt(signal)))


def _transform(path: Signature) -> Complexes:
    """Spectrum (K + 1, 3) of below, left, above of a path; the walk and the way back are a signal without ends."""
    deviation = clip_deviation(remove_common_field(path.field, path.heading)) * path.seen[:, None]
    looped = np.concatenate([deviation, deviation[::-1] * TURNED])
    return _separate_sources(np.fft.rfft(looped, axis=0))


def _invert(spectrum: Complexes, count: int) -> Floats:
    """Signal (K, 3) of a spectrum (K + 1, 3), without the walk back."""
    return np.asarray(np.fft.irfft(spectrum, 2 * count, axis=0)[:count])


def _separate_sources(spectrum: Complexes) -> Complexes:
    """Spectrum (M, 3) of along, left, up to that of below, left, above."""
    turned = -1j * spectrum[:, 0]
    below, above = spectrum[:, 2] - turned, spectrum[:, 2] + turned
    return np.stack([below / np.sqrt(2.0), spectrum[:, 1], above / np.sqrt(2.0)], axis=1)


def clip_deviation(deviation: Floats) -> Floats:
    """Limit deviations (K, 3) to `MAX_SIGMAS` robust ones."""
    limit = MAX_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(deviation), axis=0)
    return np.clip(deviation, -limit, limit)


def _pad(features: Features) -> Features:
    """Whole blocks, the last one filled with points of which nothing is known."""
    more = ((0, -len(features) % BLOCK), (0, 0))
    return Features(np.pad(features.values, more), np.pad(features.signal, more))


def remove_common_field(field: Floats, heading: Floats) -> Floats:
    """Take the Earth's field and the walker's iron from a field (K, 3) uT along paths of heading (K,) rad."""
    c, s = np.cos(heading), np.sin(heading)
    iron = np.zeros(3)
    deviation = field
    for _ in range(ROUNDS):
        along, left, up = (field - iron).T
        east, north = _smooth(np.stack([c * along - s * left, s * along + c * left], axis=1), EARTH_M).T
        earth = np.stack([c * east + s * north, c * north - s * east, np.full(len(c), np.mean(up))], axis=1)
        iron = np.mean(field - earth, axis=0)
        deviation = field - earth - iron
    return deviation


def _gains(parts: Floats, k: Floats) -> Floats:
    """W (M, 3) at wave numbers (M,), of three signals (K, 3)."""
    from scipy.signal import welch

    wave, power = welch(parts, 1.0 / SPACING_M, nperseg=min(SEGMENT, len(parts)), axis=0, average="median")
    noise = 2.0 * REPEATABILITY_UT**2 * SPACING_M
    level = np.stack([np.interp(k, wave[1:], column[1:]) for column in power.T], axis=1)
    return np.asarray(_band(k)[:, None] / np.sqrt(level + noise))


def _band(k: Floats) -> Floats:
    low = np.clip(2.0 * k * MAX_M - 1.0, 0.0, 1.0)
    high = np.clip((1.0 / MIN_M - k) / (0.2 / MIN_M), 0.0, 1.0)
    return np.asarray(np.sin(0.5 * np.pi * low) * np.sin(0.5 * np.pi * high))


def _smooth(values: Floats, length_m: float) -> Floats:
    """Means (K, c) of values (K, c) by a Hann window of a length; at the ends, of what there is."""
    window = np.hanning(round(length_m / SPACING_M) | 1)
    weight = _convolve(np.ones(len(values)), window)
    return np.stack([_convolve(column, window) / weight for column in values.T], axis=1)


def _convolve(column: Floats, window: Floats) -> Floats:
    half = len(window) // 2
    return np.asarray(np.convolve(column, window)[half : half + len(column)])
