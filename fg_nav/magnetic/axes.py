"""Axes and delay of the magnetometer against the gyroscope, from pairs of its readings while the sensor turns.

Symbols

========= ===== =======================================================================================
y_1, y_2  uT    two readings a short time apart, in the axes of the magnetometer
dR        -     body_1 to body_2 by the gyroscope, each sample held over its own period: w_1 = dR w_2
tau       s     delay of the magnetometer: a reading stamped t was measured at t - tau; either sign
h         uT    hard iron
A         -     small correction for soft iron, scale and axes: m = (I + A) (y - h)
P         -     axes of the magnetometer, a signed permutation: P y is in the axes of the gyroscope
========= ===== =======================================================================================

In a field that does not change along the path of one swing, dm/dt = -w x m, or over a short time

    r(tau, h, A) = dR(tau) m_2 - m_1 = 0.

The building's field changes by some uT in a swing, which turns the reading by 50: r is small only for the right tau and
P. No stances, attitude or gyroscope bias are needed (docs/field.md).

Pseudo-Huber loss with the median of |r| as its scale s:

    rho(r) = s^2 (sqrt(1 + |r|^2 / s^2) - 1),   weight 1 / sqrt(1 + |r|^2 / s^2).

tau, h and A by Gauss-Newton,

    dr/dtau = w_1 x m_1 - dR (w_2 x m_2),   dr/dh = -(dR - I) (I + A),   dr/dA_ij = (dR e_i) y_2j - e_i y_1j.

A is traceless, since |m| is unknown, with a prior; the prior of h is wide. The variance of tau is the sandwich of the
scores g_b of blocks of the walk, valid for residuals that are correlated within a swing:

    H^-1 (sum_b g_b g_b^T) H^-1,   plus the square of `SYSTEMATIC_S`.

Only a delay above three sigmas and `MIN_S` is removed. The readings are then interpolated to t + tau; before the first
and after the last there are none.

Axes. A magnetometer is a chip of its own, often soldered on rotated or with an axis reversed. Of the 48 signed
permutations P two each, P and -P, satisfy dR P (y_2 - h) = P (y_1 - h) alike, so 24 are compared. With h' = P h the
residual is linear,

    r = dR P y_2 - P y_1 - (dR - I) h',

and h' is solved for each P with robust weights. docs/field.md has by which loss another P than the identity is
accepted (`MIN_RATIO`, `MIN_SIGMAS`), each with its own estimate of the delay, and how P is told from -P.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes
from fg_nav.system.compiled import njit

BLOCK_ROWS = 1 << 18  # Readings that are turned at once: each needs four rotations.
TURNING_RAD_S = 1.0  # Minimum mean rate of a pair: slower, changes of the building's field hide the turn.
BLOCK_S = 2.0  # Pairs of one block, a stride or two, count as one observation of the scatter.
MAX_HELD_SHARE = 0.2  # Of the readings of a turning sensor that repeat the one before; more, and the logger holds them.
MAX_SPACING = 1.6  # Maximum distance of a pair, over the nominal one.
HARD_IRON_SIGMA_UT = 100.0  # Prior of h per axis: a turn about one axis does not observe all of it.
SPAN_S = 0.04  # Distance of a pair: short, so that the field hardly changes on the path; long enough against noise.
MAX_PAIRS = 2000  # They determine tau to 0.2 ms; a longer walk is thinned.
MIN_BLOCKS, MIN_PAIRS = 8, 100  # For a scatter.
SOFT_IRON_SIGMA = 0.05  # Prior of the elements of A: shoes, scale errors, misalignment of the chips.
MAX_STEPS, CLOSE_S = 15, 2e-5  # Of Gauss-Newton, which takes 3 to 6.
SYSTEMATIC_S = 2e-4  # Model error on simulated walks: iron beyond A, a rate that varies within a sample.
SIGMAS, MIN_S, MAX_S = 3.0, 1e-3, 0.1  # A delay that is removed: significance, least, and greatest of any sensor.
MAX_GAP = 3.0  # Spacings of the readings across which they are interpolated.


@dataclass(frozen=True)
class TurningPairs:
    """K pairs of readings while the sensor turns."""

    t: Floats  # (N,) s, of the recording.
    gyr: Floats  # (N, 3) rad/s.
    stamps: Floats  # (K, 2) s, of the two readings.
    readings: Floats  # (K, 2, 3) uT.
    block: Ints  # (K,) block of the walk that each is in, from 0 on without holes.
    n_blocks: int  # Number of blocks.
    held: bool  # Whether the logger repeats readings until there is a new one.

    def __len__(self) -> int:
        return len(self.stamps)

    def rotations(self, tau: float) -> tuple[Floats, Floats]:
        """Rotations dR (K, 3, 3) and the rates (K, 2, 3) rad/s at both ends, for a delay of tau s."""
        return rotate_between(self.t, self.gyr, self.stamps - tau)


def list_readings(recording: Recording, held: bool) -> Ints:
    """Rows (M,) with a reading of the magnetometer; where the logger holds them, with a new one."""
    if recording.mag is None:
        return np.zeros(0, dtype=np.int64)
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    return measured[_differs(recording.mag[measured])] if held else measured


def holds_readings(recording: Recording) -> bool:
    """Whether the rows between two readings of the magnetometer repeat the older one."""
    if recording.mag is None:
        return False
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    turns = (recording.gyr[measured] ** 2).sum(axis=1) > TURNING_RAD_S**2
    return bool(turns.any() and np.mean(~_differs(recording.mag[measured])[turns]) > MAX_HELD_SHARE)


def _differs(mag: Floats) -> Bools:
    """(N,) True where a reading is not the one before."""
    return np.append(True, (np.diff(mag, axis=0) != 0.0).any(axis=1))[: len(mag)]


def find_pairs(recording: Recording, span_s: float, most: int) -> TurningPairs:
    """Return pairs of readings about `span_s` apart while the sensor turns, thinned evenly to at most `most`."""
    held = holds_readings(recording)
    rows = list_readings(recording, held)
    if len(rows) < 2:
        empty = np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros(0, np.int64)
        return TurningPairs(recording.t, recording.gyr, *empty, 0, held)
    t, spacing = recording.t[rows], float(np.median(np.diff(recording.t[rows])))
    # pairs that overlap by half
    first = np.arange(0, len(t), max(1, round(span_s / spacing / 2)))
    second = np.searchsorted(t, t[first] + span_s - 0.01 * spacing)
    first, second = first[second < len(t)], second[second < len(t)]
    near = t[second] - t[first] <= MAX_SPACING * max(span_s, spacing)
    first, second = first[near], second[near]
    # those with a turn between them
    stamps = np.stack([t[first], t[second]], axis=1)
    dR, _ = rotate_between(recording.t, recording.gyr, stamps)
    angle = np.arccos(np.clip((np.trace(dR, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    turning = np.flatnonzero(angle > TURNING_RAD_S * (stamps[:, 1] - stamps[:, 0]))
    chosen = turning[:: max(1, -(-len(turning) // most))]
    stamps = stamps[chosen]
    blocks, block = np.unique(np.floor(stamps[:, 0] / BLOCK_S), return_inverse=True)
    assert recording.mag is not None
    readings = recording.mag[rows[np.stack([first[chosen], second[chosen]], axis=1)]]
    return TurningPairs(recording.t, recording.gyr, stamps, readings, block.astype(np.int64), len(blocks), held)


def compute_weights(size: Floats) -> Floats:
    """Weights of residuals of these lengths (..., K) by the pseudo-Huber loss, scaled by the median of each row."""
    scale = np.median(size, axis=-1, keepdims=True) + 1e-9
    return np.asarray(1.0 / np.sqrt(1.0 + (size / scale) ** 2))


def rotate_between(t: Floats, gyr: Floats, between: Floats) -> tuple[Floats, Floats]:
    """Rotations (K, 3, 3) between the instants (K, 2), and the rates (K, 2, 3) there; the ends' rates are held."""
    first = np.maximum(np.searchsorted(t, between[:, 0], side="right") - 1, 0)
    rotations, last = np.tile(np.eye(3), (len(between), 1, 1)), first.copy()
    _rotate(t, gyr, between, first, rotations, last)
    return rotations, gyr[np.stack([first, last], axis=1)]


@njit(cache=True)
def _rotate(t: Floats, gyr: Floats, between: Floats, first: Ints, rotations: Floats, last: Ints) -> None:
    """Integrate the rate, from sample `first`, over intervals `between` (K, 2) s; write rotations and `last` sample."""
    for k in range(len(between)):
        at, end, i, R = between[k, 0], between[k, 1], first[k], rotations[k]
        while at < end:
            until = min(t[i + 1], end) if i + 1 < len(t) else end
            rotate_in_body(R, gyr[i, 0] * (until - at), gyr[i, 1] * (until - at), gyr[i, 2] * (until - at))
            last[k] = i
            at = until
            i = min(i + 1, len(t) - 1)


@dataclass(frozen=True)
class MagnetometerDelay:
    """Delay `tau_s` of the magnetometer, negative where it is early, with its `sigma_s`."""

    tau_s: float
    sigma_s: float
    held: bool = False  # Whether the logger repeats readings until there is a new one, and those are interpolated.

    @property
    def taken_off(self) -> bool:
        """Whether it is significant, and so removed."""
        return max(SIGMAS * self.sigma_s, MIN_S) < abs(self.tau_s) <= MAX_S

    def __str__(self) -> str:
        """Remark for the user."""
        side = "late" if self.tau_s > 0 else "early"
        found = f"{1e3 * abs(self.tau_s):.1f} ms {side} (sigma {1e3 * self.sigma_s:.1f} ms)"
        said = f"the magnetometer is {found}, which is taken off" if self.taken_off else "the magnetometer has no delay"
        return f"{said}; it holds its readings: interpolated between new ones" if self.held else said


def estimate_delay(recording: Recording) -> MagnetometerDelay | None:
    """Estimate the delay of the magnetometer; None where the sensor turns too little to observe it."""
    pairs = find_pairs(recording, SPAN_S, MAX_PAIRS)
    if len(pairs) < MIN_PAIRS or pairs.n_blocks < MIN_BLOCKS:
        return None
    unknowns = np.zeros(4 + len(_TRACELESS))
    for _ in range(MAX_STEPS):
        H, scores = _linearize(pairs, unknowns)
        step = np.linalg.solve(H, -(scores.sum(axis=0) + _PRIOR * unknowns))
        unknowns = unknowns + step
        if not abs(unknowns[0]) <= 2 * MAX_S:
            return None
        if abs(step[0]) < CLOSE_S:
            break
    H, scores = _linearize(pairs, unknowns)
    variance = np.linalg.solve(H, np.linalg.solve(H, scores.T @ scores).T)[0, 0]
    return MagnetometerDelay(float(unknowns[0]), float(np.sqrt(variance + SYSTEMATIC_S**2)), pairs.held)


def _linearize(pairs: TurningPairs, unknowns: Floats) -> tuple[Floats, Floats]:
    """Normal matrix (P, P) of tau, h and A, prior included, and score (B, P) of each block, prior excluded."""
    # residuals (K, 3) uT and their derivatives (K, 3, P)
    correction = np.eye(3) + np.tensordot(unknowns[4:], _TRACELESS, axes=1)
    dR, rates = pairs.rotations(float(unknowns[0]))
    readings = pairs.readings - unknowns[1:4]
    m = readings @ correction.T
    turned = np.cross(rates, m)
    by_soft = np.einsum("aij,knj->kain", _TRACELESS, readings)
    J = np.empty((len(pairs), 3, len(unknowns)))
    J[:, :, 0] = turned[:, 0] - np.einsum("kij,kj->ki", dR, turned[:, 1])
    J[:, :, 1:4] = (np.eye(3) - dR) @ correction
    J[:, :, 4:] = np.swapaxes(by_soft[..., 1] @ np.swapaxes(dR, 1, 2) - by_soft[..., 0], 1, 2)
    r = np.einsum("kij,kj->ki", dR, m[:, 1]) - m[:, 0]
    # robust weights in units of the residuals' own variance
    size = np.sqrt((r**2).sum(axis=1))
    weight = compute_weights(size)
    weight /= max(float((weight * size**2).sum() / (3.0 * weight.sum())), 1e-6)
    weighted = weight[:, None, None] * J
    H = np.tensordot(weighted, J, axes=((0, 1), (0, 1))) + np.diag(_PRIOR)
    scores = np.zeros((pairs.n_blocks, len(unknowns)))
    np.add.at(scores, pairs.block, np.einsum("kip,ki->kp", weighted, r))
    return H, scores


_TRACELESS = np.zeros((8, 3, 3))  # Basis of A, of one size.
for _k, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))):
    _TRACELESS[_k, _i, _j] = 1.0
_TRACELESS[6] = np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0)
_TRACELESS[7] = np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0)

_PRIOR = np.array([0.0, *(HARD_IRON_SIGMA_UT**-2.0,) * 3, *(SOFT_IRON_SIGMA**-2.0,) * 8])  # Precision of tau, h, A.


def remove_delay(recording: Recording, delay: MagnetometerDelay | None) -> Recording:
    """Return the recording with its field at its stamps, where there is a significant delay or readings are held.

    Each sample is interpolated between the readings measured before and after it, both rotated by the gyroscope.
    """
    if delay is None or recording.mag is None or not (delay.taken_off or delay.held):
        return recording
    rows = list_readings(recording, delay.held)
    if len(rows) < 2:
        return recording
    tau = delay.tau_s if delay.taken_off else 0.0
    measured, read_at = recording.mag[rows], recording.t[rows] - tau
    longest = np.inf if delay.held else MAX_GAP * float(np.median(np.diff(read_at)))
    holes = recording.t[find_holes(recording.t)]
    mag, seen = np.full(recording.mag.shape, np.nan), np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    for start in range(0, len(seen), BLOCK_ROWS):
        k = seen[start : start + BLOCK_ROWS]
        t = recording.t[k]
        # readings before and after, without a hole or a long gap between them
        after = np.clip(np.searchsorted(read_at, t), 1, len(rows) - 1)
        begin, end = read_at[after - 1], read_at[after]
        known = (begin <= t) & (t <= end) & (end - begin <= longest)
        known &= np.searchsorted(holes, begin) == np.searchsorted(holes, end)
        k, after = k[known], after[known]
        t, begin, end = t[known], begin[known], end[known]
        # both in the body axes of the sample
        from_before, _ = rotate_between(recording.t, recording.gyr, np.stack([begin, t], axis=1))
        to_after, _ = rotate_between(recording.t, recording.gyr, np.stack([t, end], axis=1))
        before = np.einsum("nji,nj->ni", from_before, measured[after - 1])
        behind = np.einsum("nij,nj->ni", to_after, measured[after])
        share = ((t - begin) / (end - begin))[:, None]
        mag[k] = (1.0 - share) * before + share * behind
    return replace(recording, mag=mag)


# axes

AXES_SPAN_S = 0.2  # Distance of a pair: a swing turns the foot by a radian in it, and a delay is a small part of it.
MAX_AXES_PAIRS = 1000  # Enough for any walk.
MIN_AXES_PAIRS = 40  # For a decision.
MIN_RATIO, MIN_SIGMAS = 1.3, 5.0  # Of the losses: on 17 real walks and 90 simulated ones the identity is always best.
AXES_ROUNDS = 4  # Of reweighting: the loss of a wrong P need not be exact.
CLEARLY_UP_UT = 10.0  # Near the equator the field is level, and a shoe's iron decides.
SLOW_M_S2 = 1.0  # Of the specific force about gravity, for a known direction of up.

_SIGNED = (
    np.array(sign)[:, None] * np.eye(3)[list(order)]
    for order in permutations(range(3))
    for sign in product((1.0, -1.0), repeat=3)
)
_PROPER = np.array([P for P in _SIGNED if np.linalg.det(P) > 0])  # (24, 3, 3), the identity first.


@dataclass(frozen=True)
class MagAxes:
    """Axes of a magnetometer: `P` (3, 3), a signed permutation, turns its readings into the gyroscope's axes."""

    P: Floats

    @classmethod
    def parse(cls, words: str) -> MagAxes:
        """Read axes such as `-y,x,z`: x of the gyroscope is -y of the magnetometer. Raises `MagneticError` if none."""
        P = np.zeros((3, 3))
        named = [word.strip() for word in words.split(",")]
        for row, word in zip(P, named, strict=False):
            axis = word.lstrip("+-")
            if axis in ("x", "y", "z") and len(word) - len(axis) <= 1:
                row["xyz".index(axis)] = -1.0 if word.startswith("-") else 1.0
        if len(named) != 3 or not (np.abs(P).sum(axis=0) == 1.0).all():
            raise MagneticError(f"'{words}' names no axes: give x, y and z once each, with signs, such as -y,x,z.")
        return cls(P)

    def __str__(self) -> str:
        """Write them as `parse` reads them."""
        words = ("xyz"[int(np.flatnonzero(row)[0])] for row in self.P)
        return ",".join(("-" if row.sum() < 0 else "") + word for row, word in zip(self.P, words, strict=True))

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording with its magnetometer in the axes of the gyroscope."""
        return recording if recording.mag is None else replace(recording, mag=recording.mag @ self.P.T)

    @property
    def warning(self) -> str:
        """Remark for the user: these axes, and the option to give."""
        kind = "mirrored" if np.linalg.det(self.P) < 0 else "turned"
        south = MagAxes(-self.P)
        return (
            f"the magnetometer's axes are {kind}, as the gyroscope shows: give --mag-axes={self} if its {self} are the "
            f"gyroscope's x,y,z ({south} on the southern hemisphere)"
        )


@dataclass(frozen=True)
class AlignedMagnetometer:
    """A recording with its field in the axes of the gyroscope and at its stamps."""

    recording: Recording  # Without a magnetometer where its axes are wrong and were not given.
    delay: MagnetometerDelay | None = None  # Removed if significant; None where not observable.
    wrong_axes: MagAxes | None = None  # Of the magnetometer; None where not observable, or where they are right.

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user."""
        notes = []
        if self.wrong_axes is not None:
            use = "was not used" if self.recording.mag is None else "was used all the same"
            notes.append(f"the magnetometer {use}: {self.wrong_axes.warning}")
        if self.delay is not None and (self.delay.taken_off or self.delay.held):
            notes.append(str(self.delay))
        return tuple(notes)


def align_magnetometer(recording: Recording, axes_given: bool = False) -> AlignedMagnetometer:
    """Check the axes of the magnetometer and remove its delay.

    `axes_given`: by the user, and the recording is in them: it is then used whatever the estimated axes.
    """
    if recording.mag is None:
        return AlignedMagnetometer(recording)
    wrong = find_wrong_axes(recording)
    if wrong is not None and not axes_given:
        return AlignedMagnetometer(replace(recording, mag=None), wrong_axes=wrong)
    delay = estimate_delay(recording)
    return AlignedMagnetometer(remove_delay(recording, delay), delay, wrong)


def find_wrong_axes(recording: Recording) -> MagAxes | None:
    """Estimate the axes of a magnetometer that clearly differ from those of the gyroscope; None if they do not."""
    pairs = find_pairs(recording, AXES_SPAN_S, MAX_AXES_PAIRS)
    if len(pairs) < MIN_AXES_PAIRS or pairs.n_blocks < MIN_BLOCKS:
        return None
    size, _ = _solve_sizes(pairs, _PROPER, 0.0)
    best = int(np.argmin(_sum_losses(size, pairs).sum(axis=1)))
    if best == 0:
        return None
    # each with its own delay
    sizes = []
    for P in (np.eye(3), _PROPER[best]):
        delay = estimate_delay(MagAxes(P).apply_to(recording))
        size, hard_iron = _solve_sizes(pairs, P[None], 0.0 if delay is None else delay.tau_s)
        sizes.append(size[0])
    loss, other = _sum_losses(np.array(sizes), pairs)
    excess = loss - other
    sigma = float(np.sqrt(((excess - excess.mean()) ** 2).sum()))
    if loss.sum() < MIN_RATIO * other.sum() or excess.sum() < MIN_SIGMAS * sigma:
        return None
    down = _measure_down(recording, _PROPER[best], hard_iron[0])
    return MagAxes(_PROPER[best] if down >= 0.0 else -_PROPER[best])


def field_points_up(recording: Recording) -> bool:
    """Whether the field clearly points up where the sensor is slow: southern hemisphere, or all axes reversed."""
    return bool(_measure_down(recording, np.eye(3), np.zeros(3)) < -CLEARLY_UP_UT)


def _measure_down(recording: Recording, P: Floats, hard_iron: Floats) -> float:
    """Median downward field, uT, at slow samples; P (3, 3) to, `hard_iron` (3,) uT in gyroscope axes; 0 if none."""
    assert recording.mag is not None
    force, strength = recording.acc, np.linalg.norm(recording.acc, axis=1)
    slow = (np.abs(strength - GRAVITY_M_S2) < SLOW_M_S2) & (np.linalg.norm(recording.gyr, axis=1) < TURNING_RAD_S)
    chosen = slow & np.isfinite(recording.mag).all(axis=1)
    if not chosen.any():
        return 0.0
    along_up = ((recording.mag[chosen] @ P.T - hard_iron) * force[chosen]).sum(axis=1) / strength[chosen]
    return -float(np.median(along_up))


def _solve_sizes(pairs: TurningPairs, P: Floats, tau: float) -> tuple[Floats, Floats]:
    """Residual norms (A, K) uT of K pairs and hard iron (A, 3) uT, by IRLS, for axes P (A, 3, 3) and delay `tau` s."""
    dR, _ = pairs.rotations(tau)
    m = np.einsum("aij,knj->akni", P, pairs.readings)
    difference = np.einsum("kij,akj->aki", dR, m[:, :, 1]) - m[:, :, 0]
    by_iron = dR - np.eye(3)
    squares = np.swapaxes(by_iron, 1, 2) @ by_iron
    right = np.einsum("kij,aki->akj", by_iron, difference)
    weight, size = np.ones(difference.shape[:2]), np.linalg.norm(difference, axis=2)
    hard_iron = np.zeros((len(P), 3))
    for _ in range(AXES_ROUNDS):
        weight /= np.maximum((weight * size**2).sum(axis=1) / (3.0 * weight.sum(axis=1)), 1e-6)[:, None]
        normal = np.tensordot(weight, squares, axes=1) + np.eye(3) / HARD_IRON_SIGMA_UT**2
        hard_iron = np.linalg.solve(normal, np.einsum("ak,akj->aj", weight, right)[..., None])[..., 0]
        size = np.linalg.norm(difference - np.einsum("kij,aj->aki", by_iron, hard_iron), axis=2)
        weight = compute_weights(size)
    return size, hard_iron


def _sum_losses(size: Floats, pairs: TurningPairs) -> Floats:
    """Pseudo-Huber loss (A, B) of A axes over B blocks; the scale is that of the best axes, so losses compare."""
    scale = float(np.median(size, axis=1).min()) + 1e-9
    loss = np.sqrt(1.0 + (size / scale) ** 2) - 1.0
    return np.array([np.bincount(pairs.block, one, pairs.n_blocks) for one in loss])
