"""What a sensor that lies still tells of itself: the gyroscope's bias, the accelerometer's scale and bias.

    gyr = omega + b_g          at rest omega = 0 (the Earth's 15 deg/h are left in b_g, and so is the g-sensitivity)
    acc = s f + b_a            at rest ||f|| = g

A rest shows one number about the accelerometer, ||acc||, and four are unknown. So one attitude cannot tell scale from
bias: all it says is ||acc|| / g. Rests in several attitudes lie on a sphere with radius s g about b_a, which least
squares finds, with the covariance of the four. The attitudes must surround the centre for that: six faces do, a foot's
do not.

One scale stands for three axes. With E what scales and axes differ from that by, each entry of sd e, a rest in the
direction n_i is g n_i' E n_i off the sphere. So rests are correlated, e^2 g^2 (n_i . n_j)^2, and the covariance has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from fg_nav.arrays import Floats
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.wording import counted

UNKNOWNS = 4
"""Scale and bias of the accelerometer; fewer attitudes than that cannot show them."""

MOST_CONDITION = 1e3
"""Of the sphere's equations: beyond it the attitudes lie in a plane, but for noise."""


@dataclass(frozen=True)
class AtRestParameters:
    """How well a rest is believed."""

    gravity_m_s2: float = GRAVITY_M_S2
    """Of the place."""
    gravity_sigma_m_s2: float = 0.013
    """Of it where the place is not told: 9.780 on the equator, 9.832 on the poles."""
    axes_sigma: float = 0.003
    """e: what scales and axes of a consumer part differ by (cross-axis errors of `mpu-9250` in the simulator)."""
    force_sigma_m_s2: float = 0.01
    """Of the mean force of a rest: 1 mg, for a hand's or a table's tremor and what a bias drifts."""
    same_attitude_deg: float = 20.0
    """Attitudes closer than this are one: a sphere does not show in a cap of it."""
    shortest_attitude_s: float = 2.0
    """A rest in a new attitude is at least this long: it is not compared with the bias of others, since that changes
    with the attitude (g-sensitivity), so a slow stance must not pass for one."""
    most_bias_sigma_m_s2: float = 0.05
    """A bias known worse than this (5 mg, a common one's size) is not worth to be taken off."""


@dataclass(frozen=True)
class GyroscopeCalibration:
    """Bias of a gyroscope: `bias` and its `sigma` (3,) rad/s, from so many `rests` of so many `seconds` together."""

    bias: Floats
    sigma: Floats
    rests: int
    seconds: float

    def applied_to(self, recording: Recording) -> Recording:
        """Return the recording with the bias taken off its rates."""
        return replace(recording, gyr=recording.gyr - self.bias)


@dataclass(frozen=True)
class AccelerometerCalibration:
    """Scale and bias of an accelerometer, or how far its reading is from gravity.

    Attributes
    ----------
    scale : s; where scale and bias are not separable ||acc|| / g, which has the bias in it.
    scale_sigma : its standard deviation; infinite where not separable.
    bias : b_a (3,) m/s^2; zero where not separable.
    bias_sigma : its standard deviation (3,) m/s^2; infinite where not separable.
    norm_m_s2 : mean of ||acc|| over all rests, by their length.
    attitudes, seconds : that it rests on.
    separable : whether the attitudes tell scale from bias.
    """

    scale: float
    scale_sigma: float
    bias: Floats
    bias_sigma: Floats
    norm_m_s2: float
    attitudes: int
    seconds: float
    separable: bool

    def corrected(self, acc: Floats) -> Floats:
        """Return specific forces (n, 3) m/s^2 with bias and scale taken off; nothing is, where not separable."""
        return np.asarray((acc - self.bias) / self.scale) if self.separable else acc

    def applied_to(self, recording: Recording) -> Recording:
        """Return the recording with bias and scale taken off; raises `CalibrationError` if they are not separable."""
        if not self.separable:
            raise CalibrationError(
                f"rests in {counted(self.attitudes, 'attitude')} do not tell the accelerometer's scale "
                f"from its bias: let it lie for {AtRestParameters().shortest_attitude_s:g} s on each of its six faces."
            )
        return replace(recording, acc=self.corrected(recording.acc))


def gyroscope_at_rest(
    recording: Recording, parameters: RestParameters = RestParameters()
) -> GyroscopeCalibration | None:
    """Bias from all rests, weighted by what each is worth; None where nothing rests.

    Its sigma is not below `RestParameters.least_sigma_deg_s`, however many rests there are, and grows where they
    disagree by more than their own sigmas.
    """
    rests = find_rests(recording, parameters)
    if not rests:
        return None
    rate, sigma = np.array([rest.rate for rest in rests]), np.array([rest.sigma for rest in rests])
    weight = sigma**-2 / (sigma**-2).sum()
    bias = weight @ rate
    disagreement = (((rate - bias) / sigma[:, None]) ** 2).sum(axis=0) / max(1, len(rests) - 1)
    spread = np.sqrt(np.maximum(disagreement, 1.0) / (sigma**-2).sum())
    least = np.radians(parameters.least_sigma_deg_s)
    return GyroscopeCalibration(bias, np.maximum(spread, least), len(rests), _seconds(recording, rests))


def accelerometer_at_rest(
    recording: Recording, parameters: AtRestParameters = AtRestParameters()
) -> AccelerometerCalibration | None:
    """Scale and bias from rests in several attitudes, or ||acc|| / g from fewer; None where nothing rests."""
    p = parameters
    long = RestParameters(
        shortest_s=p.shortest_attitude_s, shortest_at_end_s=p.shortest_attitude_s, most_apart_sigmas=np.inf
    )
    rests = find_rests(recording, long) or find_rests(recording)
    if not rests:
        return None
    force = np.array([rest.force for rest in rests])
    samples = np.array([rest.stop - rest.start for rest in rests], dtype=np.float64)
    attitudes = _attitudes(force, np.radians(p.same_attitude_deg))
    norm = float(np.average(np.linalg.norm(force, axis=1), weights=samples))
    unknown = AccelerometerCalibration(
        scale=norm / p.gravity_m_s2, scale_sigma=np.inf, bias=np.zeros(3), bias_sigma=np.full(3, np.inf),
        norm_m_s2=norm, attitudes=attitudes, seconds=_seconds(recording, rests), separable=False,
    )  # fmt: skip
    return _separated(unknown, force, p) if attitudes >= UNKNOWNS else unknown


def _separated(unknown: AccelerometerCalibration, force: Floats, p: AtRestParameters) -> AccelerometerCalibration:
    """The same with scale and bias by the sphere through `force` (n, 3) m/s^2, if it is known well enough."""
    g = p.gravity_m_s2

    def off_the_sphere(x: Floats) -> Floats:
        return np.asarray(np.linalg.norm(force - x[:3], axis=1) - x[3] * g)

    found = least_squares(off_the_sphere, np.append(force.mean(axis=0), 1.0))
    direction = (force - found.x[:3]) / np.linalg.norm(force - found.x[:3], axis=1, keepdims=True)
    jacobian = np.column_stack([-direction, np.full(len(force), -g)])
    if np.linalg.cond(jacobian) > MOST_CONDITION:
        return unknown
    sigma = _sigmas(jacobian, direction, found.fun, p)
    if sigma[:3].max() > p.most_bias_sigma_m_s2:
        return unknown
    scale_sigma = float(np.hypot(sigma[3], p.gravity_sigma_m_s2 / g))
    return replace(
        unknown, scale=float(found.x[3]), scale_sigma=scale_sigma, bias=found.x[:3], bias_sigma=sigma[:3],
        separable=True,
    )  # fmt: skip


def _sigmas(jacobian: Floats, direction: Floats, residual: Floats, p: AtRestParameters) -> Floats:
    """Standard deviations of bias and scale (4,); grown where the residuals are larger than the model has them."""
    covariance = (p.axes_sigma * p.gravity_m_s2 * (direction @ direction.T)) ** 2 + p.force_sigma_m_s2**2 * np.eye(
        len(direction)
    )
    inverse = np.linalg.pinv(jacobian)
    off = np.eye(len(direction)) - jacobian @ inverse
    expected = np.trace(off @ covariance)
    growth = max(1.0, float(residual @ residual / expected)) if len(direction) > UNKNOWNS else 1.0
    return np.asarray(np.sqrt(growth * np.diag(inverse @ covariance @ inverse.T)))


def _attitudes(force: Floats, apart_rad: float) -> int:
    """Count the attitudes of forces (n, 3)."""
    distinct: list[Floats] = []
    for direction in force / np.linalg.norm(force, axis=1, keepdims=True):
        if all(other @ direction < np.cos(apart_rad) for other in distinct):
            distinct.append(direction)
    return len(distinct)


def _seconds(recording: Recording, rests: Sequence[Rest]) -> float:
    return float(sum(rest.stop - rest.start for rest in rests) * recording.period_s)
