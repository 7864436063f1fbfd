"""A walk in closed form, what a perfect sensor on the foot reads, and the 15 errors of a state: without filter code.

The pivot moves in the swings and stands in the stances; the sensor is `height` above it and tilts about it:

    position = pivot + R (0, 0, height),   R = Rz(yaw) Ry(pitch),
    body rate = (-sin(pitch) yaw', pitch', cos(pitch) yaw')

A sample is the mean of rate and specific force over its period (Gauss-Legendre of four points).
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading, wrap_angle
from fg_nav.magnetic import average_footfall_field
from fg_nav.mechanisation import NavState
from fg_nav.recording import Recording

RISE = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
BUMP = Polynomial([0, 1]) ** 4 * Polynomial([1, -1]) ** 4 * 256
GAUSS, WEIGHT = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Walk:
    """`strides` of `stride_m`, after `rest_s` at rest; each swing turns the foot by `turn` rad."""

    strides: int = 10
    stride_m: float = 1.3
    rest_s: float = 2.0
    stance_s: float = 0.4
    swing_s: float = 0.6
    turn: float = 0.2
    pitch: float = 0.7
    roll: float = 0.0  # pitch at heel strike, taken back during the stance, rad
    height: float = 0.0

    @property
    def duration_s(self):
        return self.rest_s + self.strides * (self.stance_s + self.swing_s)

    def phase(self, t):
        """Swings done, phase of the swing and of the stance that follows it, each held at 0 or 1 outside."""
        cycle = self.stance_s + self.swing_s
        done = np.clip(np.floor((t - self.rest_s) / cycle), 0, self.strides - 1)
        since = t - self.rest_s - done * cycle
        return done, np.clip(since / self.swing_s, 0, 1), np.clip((since - self.swing_s) / self.stance_s, 0, 1)

    def stands(self, t):
        _, swing, _ = self.phase(t)
        return (swing == 0) | (swing == 1)

    def _angle(self, t, order):
        """Yaw and pitch, or their derivatives by time."""
        done, swing, stance = self.phase(t)
        in_swing = RISE.deriv(order)(swing) / self.swing_s**order
        in_stance = RISE.deriv(order)(stance) / self.stance_s**order
        bump = BUMP.deriv(order)(swing) / self.swing_s**order
        yaw = self.turn * (in_swing + (done if order == 0 else 0))
        return yaw, self.pitch * bump + self.roll * (in_swing - in_stance)

    def attitude(self, t):
        return (
            Rotation.from_euler("ZY", np.stack(self._angle(t, 0), axis=-1).reshape(-1, 2))
            .as_matrix()
            .reshape(*np.shape(t), 3, 3)
        )

    def rate(self, t):
        (yaw_rate, pitch_rate), (_, pitch) = self._angle(t, 1), self._angle(t, 0)
        return np.stack([-np.sin(pitch) * yaw_rate, pitch_rate, np.cos(pitch) * yaw_rate], -1)

    def pivot(self, t, order=0):
        done, swing, _ = self.phase(t)
        course = self.turn * (done + 0.5)  # of the stride under way
        shape, lift = (curve.deriv(order)(swing) / self.swing_s**order for curve in (RISE, BUMP))
        along = self.stride_m * shape
        path = np.stack([along * np.cos(course), along * np.sin(course), 0.1 * lift], -1)
        if order == 0:
            steps = self.stride_m * np.exp(1j * self.turn * (np.arange(self.strides) + 0.5))
            start = np.concatenate([[0], np.cumsum(steps)])[done.astype(int)]
            path[..., :2] += np.stack([start.real, start.imag], -1)
        return path

    def position(self, t):
        return self.pivot(t) + self.height * self.attitude(t)[..., 2]

    def velocity(self, t):
        swing = np.cross(self.rate(t), [0.0, 0.0, self.height])
        return self.pivot(t, 1) + np.einsum("...ij,...j", self.attitude(t), swing)

    def force(self, t):
        step = 1e-4  # the acceleration of the arm by a central difference of its exact velocity
        ahead, behind = (self.velocity(t + s) - self.pivot(t + s, 1) for s in (step, -step))
        pulled = self.pivot(t, 2) + (ahead - behind) / (2 * step) + [0.0, 0.0, GRAVITY_M_S2]
        return np.einsum("...ji,...j", self.attitude(t), pulled)

    def samples(self, t, h):
        """Means of specific force and rate (N, 3) over the periods from each stamp on."""
        at = t[:, None] + h * (GAUSS + 1) / 2
        return (self.force(at) * WEIGHT[:, None]).sum(1) / 2, (self.rate(at) * WEIGHT[:, None]).sum(1) / 2

    def recording(self, rate_hz=200.0):
        t = np.arange(round(self.duration_s * rate_hz)) / rate_hz
        acc, gyr = self.samples(t, 1 / rate_hz)
        return Recording(t=t, acc=acc, gyr=gyr), Stances.from_mask(self.stands(t) & self.stands(t + 1 / rate_hz))


# with a magnetometer, in a field that is the Earth's unless given otherwise

STRAIGHT = Walk(strides=60, turn=0.0, pitch=0.3)
NAV_FIELD = np.array([0.0, 21.0, -43.0])
SWAY_DEG, SWAY_HZ = 0.01, 1.0  # Rms about each axis of the standing foot: two seconds show the bias to 0.04 deg/s.


def walked(walk, turned_deg=None, gyro_bias_deg_s=0.0, from_s=0.0):
    """Recording, stances, field and the true headings (N,).

    The field points north, turned by `turned_deg` (t) clockwise; the gyro is biased about up from `from_s` on. The foot
    sways while it stands at the start, whole periods.
    """
    inertial, stances = walk.recording(100.0)
    t, attitude = inertial.t, walk.attitude(inertial.t)
    turned = np.zeros(len(t)) if turned_deg is None else turned_deg(t)
    field = Rotation.from_euler("z", -turned[:, None], degrees=True).apply(NAV_FIELD)
    bias = np.where(t >= from_s, np.radians(gyro_bias_deg_s), 0.0)
    turn = 2 * np.pi * SWAY_HZ
    sway = np.where(t < walk.rest_s, -np.radians(SWAY_DEG) * np.sqrt(2.0) * turn * np.sin(turn * t), 0.0)
    gyr = inertial.gyr + attitude[:, 2] * bias[:, None] + sway[:, None]
    recording = Recording(t, inertial.acc, gyr, np.einsum("nji,nj->ni", attitude, field))
    headings = compute_heading(attitude)
    return recording, stances, average_footfall_field(recording, stances, float(headings[0])), headings


def off_deg(solution, headings):
    """Heading errors (N,) in degrees."""
    return np.degrees(wrap_angle(compute_heading(solution.nav_R_body) - headings))


# the 15 errors, estimate minus truth, put on a state and read off again


def with_error(truth, error):
    turned = Rotation.from_rotvec(error[6:9]).as_matrix() @ truth.nav_R_body
    p, v, _, bg, ba = truth
    return NavState(p + error[:3], v + error[3:6], turned, bg + error[9:12], ba + error[12:])


def error_of(estimate, truth):
    turn = Rotation.from_matrix(estimate.nav_R_body @ truth.nav_R_body.T).as_rotvec()
    p, v, bg, ba = (estimate[k] - truth[k] for k in (0, 1, 3, 4))
    return np.concatenate([p, v, turn, bg, ba])


def random_state(seed, nav_R_body=None, gyro_bias=None):
    """A state with any errors, but for the attitude and the bias that are given."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(rng=rng).as_matrix()
    state = NavState(*rng.standard_normal((2, 3)), R, *(0.01 * rng.standard_normal((2, 3))))
    for own, given in ((state.nav_R_body, nav_R_body), (state.gyro_bias, gyro_bias)):
        own[:] = own if given is None else given
    return state


def random_covariance(seed, size=15):
    root = np.random.default_rng(seed).standard_normal((size, size))
    return root @ root.T
