"""How late the magnetometer is behind the gyroscope, found in the swings of a recording, and taken off.

A chip reports the middle of the time that it measured, its driver passes that on later, or a filter delays the
gyroscope: tau has either sign. At 8 rad/s a delay of 20 ms turns the field in nav by 9 deg, which is 7 uT of 45. With
the residual of `fg_nav.magnetic.turning_pairs`, and a correction I + A near the identity for soft iron, scale and axes,

    r(tau, h, A) = dR(tau) m_2 - m_1,    m = (I + A) (y - h),

    dr/dtau = w_1 x m_1 - dR (w_2 x m_2),   dr/dh = -(dR - I) (I + A),   dr/dA_ij = (dR e_i) y_2j - e_i y_1j

tau, h and A are solved together by Gauss-Newton with robust weights. A has no trace, since |m| is not known, and a
prior; h a wide one. The variance of tau is that of the scores g_b of blocks of the walk, which is true for residuals
that are correlated within a swing:

    H^-1 (sum_b g_b g_b^T) H^-1,   plus the square of `SYSTEMATIC_S`.

A magnetometer without a delay is not touched: what is taken off is above three sigmas and above `MIN_S`. The readings
are then those at t + tau, interpolated between measured ones; before the first and after the last there are none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.magnetic.turning_pairs import (
    HARD_IRON_SIGMA_UT,
    TurningPairs,
    compute_weights,
    find_pairs,
    list_readings,
    rotate_between,
)
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages, empty_column, take_rows

SPAN_S = 0.04
"""Between the readings of a pair: a field that changes along the path has little time to, and noise does not rule."""

MAX_PAIRS = 2000  # They show tau to 0.2 ms; a longer walk is thinned.
MIN_BLOCKS, MIN_PAIRS = 8, 100  # Fewer make no scatter.
SOFT_IRON_SIGMA = 0.05  # Prior of the elements of A: shoes, scale errors and the turn of one chip against the other.
MAX_STEPS, CLOSE_S = 15, 2e-5  # Of Gauss-Newton: it takes 3 to 6.

SYSTEMATIC_S = 2e-4
"""What the model leaves out (iron beyond A, a rate that is not constant over a sample), on simulated walks."""

SIGMAS, MIN_S, MAX_S = 3.0, 1e-3, 0.1
"""A delay is taken off where it is so many sigmas and so long, and no longer than a sensor can have."""

MAX_GAP = 3.0  # Spacings of the readings across which they are interpolated.


@dataclass(frozen=True)
class MagnetometerDelay:
    """How late the magnetometer is: `tau_s`, negative where it is early, its `sigma_s`, and whether it is `taken_off`.

    `held` where the logger repeats readings until there is a new one: those between are then interpolated.
    """

    tau_s: float
    sigma_s: float
    held: bool = False

    @property
    def taken_off(self) -> bool:
        """Whether it is one."""
        return max(SIGMAS * self.sigma_s, MIN_S) < abs(self.tau_s) <= MAX_S

    def __str__(self) -> str:
        """Say it to the user."""
        side = "late" if self.tau_s > 0 else "early"
        found = f"{1e3 * abs(self.tau_s):.1f} ms {side} (sigma {1e3 * self.sigma_s:.1f} ms)"
        said = f"the magnetometer is {found}, which is taken off" if self.taken_off else "the magnetometer has no delay"
        return f"{said}; it holds its readings: interpolated between new ones" if self.held else said


def estimate_delay(recording: Recording) -> MagnetometerDelay | None:
    """Estimate how late the magnetometer is; None where the sensor turns too little to show it."""
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


def remove_delay(recording: Recording, delay: MagnetometerDelay | None) -> Recording:
    """Return the recording with its field at its stamps, where a delay is to be taken off or readings are held."""
    if delay is None or recording.mag is None or not (delay.taken_off or delay.held):
        return recording
    rows = list_readings(recording, delay.held)
    if len(rows) < 2:
        return recording
    tau = delay.tau_s if delay.taken_off else 0.0
    return replace(recording, mag=_read_at(recording, rows, tau, delay.held))


def _read_at(recording: Recording, rows: Ints, tau: float, held: bool) -> Floats:
    """Field (N, 3) at the stamps, between the readings stamped before and after them, each turned by the gyroscope."""
    assert recording.mag is not None
    measured, read_at = take_rows(rows, recording.mag), recording.t[rows] - tau
    longest = np.inf if held else MAX_GAP * float(np.median(np.diff(read_at)))
    holes = recording.t[find_holes(recording.t)]
    mag = empty_column(*recording.mag.shape)
    for start in range(0, len(mag), BLOCK_ROWS):
        block = np.s_[start : start + BLOCK_ROWS]
        mag[block] = np.nan
        k = start + np.flatnonzero(np.isfinite(recording.mag[block]).all(axis=1))
        t = recording.t[k]
        after = np.clip(np.searchsorted(read_at, t), 1, len(rows) - 1)
        begin, end = read_at[after - 1], read_at[after]
        known = (begin <= t) & (t <= end) & (end - begin <= longest)
        known &= np.searchsorted(holes, begin) == np.searchsorted(holes, end)
        k, after = k[known], after[known]
        t, begin, end = t[known], begin[known], end[known]
        share = ((t - begin) / (end - begin))[:, None]
        from_before, _ = rotate_between(recording.t, recording.gyr, np.stack([begin, t], axis=1))
        to_after, _ = rotate_between(recording.t, recording.gyr, np.stack([t, end], axis=1))
        before = np.einsum("nji,nj->ni", from_before, measured[after - 1])
        behind = np.einsum("nij,nj->ni", to_after, measured[after])
        mag[k] = (1.0 - share) * before + share * behind
        drop_pages()
    return mag


def _linearize(pairs: TurningPairs, unknowns: Floats) -> tuple[Floats, Floats]:
    """Normal matrix (P, P) with its prior, and the scores (B, P) of the blocks without."""
    r, J = _compute_residual(pairs, unknowns)
    size = np.sqrt((r**2).sum(axis=1))
    weight = compute_weights(size)
    weight /= max(float((weight * size**2).sum() / (3.0 * weight.sum())), 1e-6)
    weighted = weight[:, None, None] * J
    H = np.tensordot(weighted, J, axes=((0, 1), (0, 1))) + np.diag(_PRIOR)
    scores = np.zeros((pairs.n_blocks, len(unknowns)))
    np.add.at(scores, pairs.block, np.einsum("kip,ki->kp", weighted, r))
    return H, scores


def _compute_residual(pairs: TurningPairs, unknowns: Floats) -> tuple[Floats, Floats]:
    """Residuals (K, 3) uT and their derivatives (K, 3, P) by tau, h and A."""
    correction = np.eye(3) + np.tensordot(unknowns[4:], _TRACELESS, axes=1)
    dR, rates = pairs.rotations(float(unknowns[0]))
    readings = pairs.readings - unknowns[1:4]
    m = readings @ correction.T
    turned = np.cross(rates, m)
    J = np.empty((len(pairs), 3, len(unknowns)))
    J[:, :, 0] = turned[:, 0] - np.einsum("kij,kj->ki", dR, turned[:, 1])
    J[:, :, 1:4] = (np.eye(3) - dR) @ correction
    by_soft = np.einsum("aij,knj->kain", _TRACELESS, readings)
    J[:, :, 4:] = np.swapaxes(by_soft[..., 1] @ np.swapaxes(dR, 1, 2) - by_soft[..., 0], 1, 2)
    return np.einsum("kij,kj->ki", dR, m[:, 1]) - m[:, 0], J


_TRACELESS = np.zeros((8, 3, 3))  # The matrices A is made of, of one size.
for _k, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))):
    _TRACELESS[_k, _i, _j] = 1.0
_TRACELESS[6] = np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0)
_TRACELESS[7] = np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0)

_PRIOR = np.array([0.0, *(HARD_IRON_SIGMA_UT**-2.0,) * 3, *(SOFT_IRON_SIGMA**-2.0,) * 8])
"""Precision of tau, h and A about zero."""
