"""The field along a path, by the distance that was walked, and the part of it that repeats.

Symbols: distance d (m, horizontal, along the path), position p (m), attitude R = nav_R_body, body field m (uT),
direction of walking u (unit vector, level), l to its left, heading psi of u, wave number k (1/m) along the path.
Frames: nav is East-North-Up (`fg_nav`).

Signature
---------
The field is averaged over distance, not over time. Over a piece of the path from d to d + D

    b(d) = (1 / D) integral of R m dd        over all samples between,

so that a foot counts while it moves and a stance, however long, is one point of the path. By components

    b_along = b . u,    b_left = b . l,    b_up.

This mean repeats, and the value at a footfall does not: coherence of two passes 0.35 m (rms) apart, wavelengths of 5 to
10 m, 0.92-0.95, 0.7-0.8, 0.6-0.9 against 0.70, 0.5, 0.6 (`place_recognition.py coherence` of b894e160).

The walking direction is that of a chord of 3 m. In reverse of the walk b_along and b_left change sign, b_up does not.

Earth and iron
--------------
In nav, the Earth's field e, which slowly turns as the path's heading drifts; in the walking frame, the iron h of shoe
and sensor:

    b(d) = Rot(-psi(d)) e(d) + h + deviation(d),

e the mean in nav over `EARTH_M`, h that of the walk, found in turns.

Sources
-------
Over distances the potential of sources below the path falls off upward, that of sources above it downward. In two
dimensions (nothing changes to the left) a wave of sources below has B_along = a sin(kd), B_up = a cos(kd): with the
Hilbert transform H along the path up = -H[along], of sources above up = +H[along] (Nabighian 1972). So

    below = (up - H[along]) / sqrt 2,    left,    above = (up + H[along]) / sqrt 2

are three components without correlation, where along and up are one signal seen twice (quadrature -0.8 to -0.95 on
simulated floors and on the phones of `magnetic_paths`). Their signs in the opposite direction of walking are +, -, +.

Whitening
---------
With the spectrum S(k) of the deviation, Welch's of the walk, and N, that of the difference of two readings, the filter

    W(k) = band(k) / sqrt(S(k) + N)

gives all wavelengths in the band the same weight, as their likelihood ratio has it (Whittle 1953). The band is from
`MAX_M`, beyond which drift and the Earth are, to `MIN_M`, below which passes some decimetres apart do not repeat.

The result x is divided by its own rms a(d) over `LOCAL_M`. Of a^2 the share q = 1 - n^2 / a^2 is the field's, n^2 being
N's part. A deviation beyond `MAX_SIGMAS` robust ones is limited to these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import MAD_TO_SIGMA, Bools, Brief, Complexes, Floats, interpolate_columns

SPACING_M = 0.5  # Of the points along the path: four to the shortest wavelength that repeats.
BLOCK = 8  # Points of a block, 4 m, the smallest piece that candidates are made of.
CHORD_M = 3.0  # Whose direction is that of walking: two strides.
MAX_UNREAD_M = 0.5  # Distance to the nearest reading of the magnetometer, beyond which the field is not known.
MIN_POINTS = 40  # A path of less than 20 m is no path to return on.
EARTH_M = 80.0  # Over which the Earth's field is averaged: many objects, and a heading that drifts by a few degrees.
ROUNDS = 3  # In which Earth and iron are found in turns.
MAX_M, MIN_M = 20.0, 2.0  # Band: full from the one to 1.25 of the other, none at half of it beyond (cosine edges).
REPEATABILITY_UT = 0.5  # By which two readings of one place differ at each point: noise, and tilt (0.5 deg of 50 uT).
LOCAL_M = 25.0  # Over which the scale is taken: several of the wavelengths.
MIN_POWER = 1e-12  # Keeps a field that is the same everywhere from a division by zero.
SEGMENT = 64  # Points (32 m) of Welch's segments.
MAX_SIGMAS = 5.0  # Of deviations: normal ones do not come near.
MIN_SIGNAL = 0.02  # q below which there is none.
REVERSED = np.array([1.0, -1.0, 1.0])  # Signs of below, left, above in the opposite direction of walking.
TURNED = np.array([-1.0, -1.0, 1.0])  # Signs of along, left, up there.


@dataclass(frozen=True)
class Signature(Brief):
    """The field along a path, at K points that are `SPACING_M` apart."""

    distance_m: Floats  #: (K,) walked so far.
    t: Floats  #: (K,) s, when the middle of the piece was passed.
    position: Floats  #: (K, 3) m in nav.
    heading: Floats  #: (K,) rad, counterclockwise from east: the direction of walking.
    field: Floats  #: (K, 3) uT along the walking direction, to its left, and up.
    seen: Bools  #: (K,) whether the magnetometer read there.

    def __len__(self) -> int:
        return len(self.t)


def trace_signature(t: Floats, position: Floats, nav_R_body: Floats, mag: Floats) -> Signature:
    """Return the field and pose along a path, averaged over equal distances.

    `t` (N,) s, rising; `position` (N, 3) m in nav; `nav_R_body` (N, 3, 3); `mag` (N, 3) uT, calibrated body field, NaN
    rows where there is no reading.
    """
    read = np.asarray(np.isfinite(mag).all(axis=1))
    # distance over ground
    walked = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)))
    edges = np.arange(0.0, walked[-1], SPACING_M)
    if read.sum() < 2 or len(edges) <= MIN_POINTS:
        none = np.zeros(0)
        return Signature(none, none, np.zeros((0, 3)), none, np.zeros((0, 3)), np.zeros(0, dtype=bool))
    # field in nav, without a reading by those around
    nav_field = np.einsum("nij,nj->ni", nav_R_body, mag)
    if not read.all():
        for column in nav_field.T:
            column[~read] = np.interp(t[~read], t[read], column[read])
    # means over distance: exact differences of line integrals, whatever the sample rate
    middle = 0.5 * (edges[1:] + edges[:-1])
    place, field = _average(walked, position, edges), _average(walked, nav_field, edges)
    # direction of walking: of chords
    reach, last, i = round(CHORD_M / SPACING_M / 2), len(place) - 1, np.arange(len(place))
    chord = place[np.minimum(i + reach, last), :2] - place[np.maximum(i - reach, 0), :2]
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    u = np.asarray(np.where(length > 0.0, chord / np.maximum(length, 1e-9), [1.0, 0.0]))
    along, left = (field[:, :2] * u).sum(axis=1), u[:, 0] * field[:, 1] - u[:, 1] * field[:, 0]
    # distance to the nearest reading
    known = walked[read]
    after = np.clip(np.searchsorted(known, middle), 1, len(known) - 1)
    unread_m = np.minimum(np.abs(middle - known[after - 1]), np.abs(middle - known[after]))
    return Signature(
        distance_m=middle,
        t=_at_distance(walked, t[:, None], middle)[:, 0],
        position=place,
        heading=np.unwrap(np.arctan2(u[:, 1], u[:, 0])),
        field=np.stack([along, left, field[:, 2]], axis=1),
        seen=unread_m < MAX_UNREAD_M,
    )


def _average(walked: Floats, values: Floats, edges: Floats) -> Floats:
    """Means over distance (K, c) between `edges` (K + 1,) m of values (N, c) at distances `walked` (N,) m."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(walked)[:, None]
    integral = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    return np.asarray(np.diff(_at_distance(walked, integral, edges), axis=0) / SPACING_M)


def _at_distance(walked: Floats, values: Floats, asked: Floats) -> Floats:
    """Values (K, c) at distances (K,); those of a standing are those of its begin."""
    distinct, first = np.unique(walked, return_index=True)
    return interpolate_columns(asked, distinct, values[first])


# the part that repeats


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
        """Return those of the negated field: of no place of this walk, but as rough, with the same spectra."""
        return Features(-self.values, self.signal)


def whiten(path: Signature, like: Signature | None = None) -> Features:
    """Return the field of a path, whitened by its own spectra or those of `like`, and its signal correlation."""
    from scipy.signal import welch

    spectrum = _transform(path)
    parts = _invert(spectrum, len(path)) if like is None else _invert(_transform(like), len(like))
    # the filter W
    k = np.asarray(np.fft.rfftfreq(2 * len(path), SPACING_M), dtype=np.float64)
    low, high = np.clip(2.0 * k * MAX_M - 1.0, 0.0, 1.0), np.clip((1.0 / MIN_M - k) / (0.2 / MIN_M), 0.0, 1.0)
    band = np.asarray(np.sin(0.5 * np.pi * low) * np.sin(0.5 * np.pi * high))
    wave, power = welch(parts, 1.0 / SPACING_M, nperseg=min(SEGMENT, len(parts)), axis=0, average="median")
    noise = 2.0 * REPEATABILITY_UT**2 * SPACING_M
    level = np.stack([np.interp(k, wave[1:], column[1:]) for column in power.T], axis=1)
    gain = np.asarray(band[:, None] / np.sqrt(level + noise))
    values = _invert(spectrum * gain, len(path))
    # to the same scale everywhere, of which the field has a share
    power = _smooth(values**2, LOCAL_M) + MIN_POWER
    signal = 1.0 - REPEATABILITY_UT**2 * np.mean(gain**2, axis=0) / power
    signal = np.where((signal > MIN_SIGNAL) & path.seen[:, None], signal, 0.0)
    # whole blocks, the last one filled with points of which nothing is known
    more = ((0, -len(values) % BLOCK), (0, 0))
    return Features(np.pad(values / np.sqrt(power), more), np.pad(np.sqrt(signal), more))


def _transform(path: Signature) -> Complexes:
    """Spectrum (K + 1, 3) of below, left, above of a path; the walk and the way back are a signal without ends."""
    deviation = clip_deviation(remove_common_field(path.field, path.heading)) * path.seen[:, None]
    spectrum = np.fft.rfft(np.concatenate([deviation, deviation[::-1] * TURNED]), axis=0)
    turned = -1j * spectrum[:, 0]
    below, above = spectrum[:, 2] - turned, spectrum[:, 2] + turned
    return np.stack([below / np.sqrt(2.0), spectrum[:, 1], above / np.sqrt(2.0)], axis=1)


def _invert(spectrum: Complexes, count: int) -> Floats:
    """Signal (K, 3) of a spectrum (K + 1, 3), without the walk back."""
    return np.asarray(np.fft.irfft(spectrum, 2 * count, axis=0)[:count])


def clip_deviation(deviation: Floats) -> Floats:
    """Limit deviations (K, 3) to `MAX_SIGMAS` robust ones."""
    limit = MAX_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(deviation), axis=0)
    return np.clip(deviation, -limit, limit)


def remove_common_field(field: Floats, heading: Floats) -> Floats:
    """Return the anomaly (K, 3) uT: field less its smooth part in nav (Earth) and constant part on the path (iron)."""
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


def _smooth(values: Floats, length_m: float) -> Floats:
    """Means (K, c) of values (K, c) by a Hann window of a length; at the ends, of what there is."""
    window = np.hanning(round(length_m / SPACING_M) | 1)
    first, stop = len(window) // 2, len(window) // 2 + len(values)
    weight = np.convolve(np.ones(len(values)), window)[first:stop]
    return np.stack([np.convolve(column, window)[first:stop] / weight for column in values.T], axis=1)
