"""A floor with steel in it, and walks on it: the field of a random harmonic potential, and paths with a drift."""

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import yaw_rotation
from fg_nav.places import SavedPlaces, Signature, Stretch, trace_signature

EARTH = np.array([1.0, 21.0, -43.0])
SPEED_M_S = 1.25


@dataclass(frozen=True)
class Floor:
    """phi = sum (b / k) cos(k . x + c) exp(-k z), B = EARTH - grad phi; waves of given lengths, 4 uT an axis."""

    wave: Floats
    phase: Floats
    strength: Floats

    @classmethod
    def draw(cls, seed: int, count: int = 120, waves_m: tuple[float, float] = (1.5, 12.0)) -> "Floor":
        rng = np.random.default_rng(seed)
        k = 2 * np.pi / np.exp(rng.uniform(*np.log(waves_m), count))
        angle = rng.uniform(0, 2 * np.pi, count)
        wave = np.stack([k * np.cos(angle), k * np.sin(angle)], axis=1)
        return cls(wave, rng.uniform(0, 2 * np.pi, count), 6.0 * np.sqrt(2.0 / count) * np.exp(0.1 * k))

    def at(self, place: Floats) -> Floats:
        k = np.linalg.norm(self.wave, axis=1)
        phase = place[:, :2] @ self.wave.T + self.phase
        b = self.strength * np.exp(-np.outer(place[:, 2], k))
        level = (b * np.sin(phase)) @ (self.wave / k[:, None])
        return EARTH + np.column_stack([level, (b * np.cos(phase)).sum(axis=1)])


def along(corners, step_m: float = 0.05) -> Floats:
    """Points along straight lines between corners (M, 2), at a sensor's height over the floor."""
    corners = np.asarray(corners, dtype=float)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    s = np.arange(0.0, arc[-1], step_m)
    return np.stack([np.interp(s, arc, corners[:, 0]), np.interp(s, arc, corners[:, 1]), 0.15 + 0.0 * s], axis=1)


def carry(floor: Floor, place: Floats, drift_deg_m: float = 0.0, noise_uT: float = 0.3, seed: int = 0) -> Signature:
    """Signature of a walk at these places; its odometry turns by so much."""
    rng = np.random.default_rng(seed)
    steps = np.diff(place, axis=0)
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    R = yaw_rotation(np.deg2rad(drift_deg_m) * walked)
    position = np.vstack([np.zeros(3), np.cumsum(np.einsum("nij,nj->ni", R[1:], steps), axis=0)])
    mag = floor.at(place) + rng.normal(0.0, noise_uT, place.shape)
    return trace_signature(walked / SPEED_M_S, position, R, mag)


def save(path: Signature, sigma_m: float = 0.1) -> SavedPlaces:
    return SavedPlaces(path, np.full((len(path), 3), sigma_m))


LOOP = np.array([(0, 0), (30, 0), (30, 18), (0, 18), (0, 0)])  # 96 m.
OPEN = np.array([(0, 0), (60, 0), (60, 60), (120, 60), (120, 120)])  # 240 m without a return.


def retrace(
    opposite: bool,
    drift_deg_m: float = 0.0,
    floor: Floor = Floor.draw(1),
    aside: Floats = np.zeros(2),
    noise_uT: float = 0.3,
) -> tuple[Signature, Stretch]:
    """Twice the same 96 m, the second time so many m aside: the walk, and the stretch that is true of it."""
    there = along(LOOP)
    again = (there[::-1] if opposite else there) + np.append(aside, 0.0)
    walk = carry(floor, np.vstack([there, again]), drift_deg_m, noise_uT)
    later = np.arange(202.0, len(walk) - 10.0)
    earlier = 2.0 * 95.95 / 0.5 - 1.0 - later if opposite else later - 96.0 / 0.5
    return walk, Stretch(later, earlier, opposite, 100.0, 1e-5)
