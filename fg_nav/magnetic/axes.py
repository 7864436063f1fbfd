"""Axes of the magnetometer against those of the gyroscope: dm/dt = -w x m holds for the right ones only.

A magnetometer is a chip of its own, often soldered on rotated or with an axis reversed. Of the 48 signed permutations P
two each, P and -P, satisfy dR P (y_2 - h) = P (y_1 - h) alike (`fg_nav.magnetic.delay`), so 24 are compared. With
h' = P h the residual is linear,

    r = dR P y_2 - P y_1 - (dR - I) h',

and h' is solved for each P with robust weights. The loss of each is summed over blocks of the recording; another P than
the identity is accepted where the loss of the identity is `MIN_RATIO` times as large, and larger by `MIN_SIGMAS` of
the scatter of that difference over the blocks, each with its own estimate of the delay. A foot turns about one axis
above all, about which half a turn of the magnetometer would hardly be observable, but it also rolls and turns into
curves.

The gyroscope cannot separate P from -P: the one whose field points down where the foot is slow is chosen, as on the
northern hemisphere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.delay import (
    HARD_IRON_SIGMA_UT,
    TURNING_RAD_S,
    MagnetometerDelay,
    TurningPairs,
    compute_weights,
    estimate_delay,
    find_pairs,
    remove_delay,
)
from fg_nav.recording import Recording

SPAN_S = 0.2  # Distance of a pair: a swing turns the foot by a radian in it, and a delay is a small part of it.
MAX_PAIRS = 1000  # Enough for any walk.
MIN_BLOCKS, MIN_PAIRS = 8, 40  # For a decision.
MIN_RATIO, MIN_SIGMAS = 1.3, 5.0  # Of the losses: on 17 real walks and 90 simulated ones the identity is always best.
ROUNDS = 4  # Of reweighting: the loss of a wrong P need not be exact.
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
    """A recording with its field in the axes of the gyroscope and at its stamps.

    `delay` as estimated, removed if significant; `wrong_axes` those of the magnetometer; None where not observable, or
    where they are right. With wrong axes that were not given the recording has no magnetometer.
    """

    recording: Recording
    delay: MagnetometerDelay | None = None
    wrong_axes: MagAxes | None = None

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

    Parameters
    ----------
    recording : with the magnetometer in the axes of the gyroscope, as far as known.
    axes_given : by the user: the magnetometer is then used whatever the estimated axes.
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
    pairs = find_pairs(recording, SPAN_S, MAX_PAIRS)
    if len(pairs) < MIN_PAIRS or pairs.n_blocks < MIN_BLOCKS:
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
    for _ in range(ROUNDS):
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
