"""The built-in demonstration: one minute of walking round an L-shaped corridor, back to the start.

The foot stands for three seconds, walks about 77 m in strides of about 1.29 m and 0.93 s, six right-angled
corners on the way, and stands again exactly where it started (`fg_nav.simulation.strides` says how it moves).

The sensor adds white noise and constant biases, the field is homogeneous: less than a real foot suffers (no
impacts, no scale errors, no reinforced floor). It shows that everything works, not how well it works outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Provenance, Recording, TrajectoryTruth
from fg_nav.simulation.gait import FootMotion
from fg_nav.simulation.strides import Gait, Strides, foot_motion

STANDING_S = 3.0
"""How long the foot stands at the start and at the end."""

LEGS_M = (11.0, 9.0, 11.0, 10.0, 10.0, 19.0, 10.0)
"""The corridor from corner to corner; it starts and ends in the middle of its first wall."""

RIGHT_TURNS = (1, 1, -1, 1, 1, 1)
"""The corners between: +1 to the right, -1 to the left."""

CORNER_RADIUS_M = 1.2


@dataclass(frozen=True)
class DemoSensor:
    """A sensor: white noise in every sample and one draw of each bias, as of an industrial MEMS unit.

    Attributes
    ----------
    acc_noise_m_s2, gyr_noise_rad_s, mag_noise_uT : standard deviation of a sample.
    acc_bias_m_s2, gyr_bias_rad_s : standard deviation of the constant bias, per axis.
    nav_field_uT : the Earth's field in East-North-Up (central Europe, declination left out).
    """

    acc_noise_m_s2: float = 0.03
    gyr_noise_rad_s: float = float(np.deg2rad(0.1))
    mag_noise_uT: float = 0.3
    acc_bias_m_s2: float = 0.02
    gyr_bias_rad_s: float = float(np.deg2rad(0.1))
    nav_field_uT: tuple[float, float, float] = (0.0, 20.0, -44.0)


def demo_walk(rng: np.random.Generator, rate_hz: float = 200.0) -> Recording:
    """One minute round a corridor, with the true trajectory of the sensor.

    A sample is the mean over the period that begins at its stamp.

    Parameters
    ----------
    rng : source of the gait's variability, the biases and the noise.
    rate_hz : sample rate.

    Returns
    -------
    Recording
        With magnetometer and `TrajectoryTruth`: position and attitude, from the origin, heading north.
    """
    motion, duration_s = demo_motion(rng)
    t = np.arange(int(duration_s * rate_hz) + 1) / rate_hz
    sensor = DemoSensor()
    rate, force = motion.sampled(t, 1 / rate_hz)
    state = motion.at(t)
    body_field = np.einsum("nji,j->ni", state.nav_R_body, np.array(sensor.nav_field_uT))
    return Recording(
        t=t,
        acc=_measured(force, sensor.acc_bias_m_s2, sensor.acc_noise_m_s2, rng),
        gyr=_measured(rate, sensor.gyr_bias_rad_s, sensor.gyr_noise_rad_s, rng),
        mag=_measured(body_field, 0.0, sensor.mag_noise_uT, rng),
        truth=TrajectoryTruth(t=t, position=state.position - state.position[0], nav_R_body=state.nav_R_body),
        provenance=Provenance(format="demo", notes=("simulated",)),
    )


def demo_motion(rng: np.random.Generator, gait: Gait = Gait()) -> tuple[FootMotion, float]:
    """Draw the foot's motion; returns it with its duration in s."""
    footprint, heading = _footprints(gait, rng)
    duration = gait.stride_s * (1 + gait.variation * rng.standard_normal(len(heading) - 1))
    start = STANDING_S + np.concatenate([[0.0], np.cumsum(duration[:-1])])
    motion = foot_motion(Strides(start, duration, footprint, heading), gait, rng)
    return motion, float(start[-1] + duration[-1] + STANDING_S)


def _measured(true: Floats, bias_sd: float, noise_sd: float, rng: np.random.Generator) -> Floats:
    return true + bias_sd * rng.standard_normal(3) + noise_sd * rng.standard_normal(true.shape)


def _footprints(gait: Gait, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Footprints (K + 1, 2) m and headings of the foot (K + 1,) rad; the last footprint is the first."""
    arc, xy, heading = _corridor()
    length = 1 + gait.variation * rng.standard_normal(round(arc[-1] / gait.stride_m) + 1)
    length[[0, -1]] *= 0.5  # a walk starts and ends with a step, half a stride of the foot
    along = np.concatenate([[0.0], np.cumsum(length)]) * arc[-1] / length.sum()
    footprint = np.stack([np.interp(along, arc, xy[:, i]) for i in range(2)], axis=1)
    toe_heading = np.interp(along, arc, heading)
    footprint[1:-1] += gait.footprint_m * rng.standard_normal((len(along) - 2, 2))
    toe_heading[1:-1] += gait.toe_out_rad * rng.standard_normal(len(along) - 2)
    return footprint, toe_heading


def _corridor(step_m: float = 0.01) -> tuple[Floats, Floats, Floats]:
    """Arc length (M,) m, position (M, 2) m and heading (M,) rad along the corridor, corners rounded."""
    turns = np.pi / 2 * np.array(RIGHT_TURNS)
    straight = np.array(LEGS_M) - CORNER_RADIUS_M * np.array([1] + [2] * (len(LEGS_M) - 2) + [1])
    pieces = np.insert(straight, np.arange(1, len(straight)), CORNER_RADIUS_M * np.abs(turns))
    knot_arc = np.concatenate([[0.0], np.cumsum(pieces)])
    knot_heading = np.repeat(np.concatenate([[0.0], np.cumsum(turns)]), 2)
    arc = np.linspace(0.0, knot_arc[-1], round(knot_arc[-1] / step_m) + 1)
    middle = np.interp((arc[1:] + arc[:-1]) / 2, knot_arc, knot_heading)
    step = np.stack([np.sin(middle), np.cos(middle)], axis=1) * np.diff(arc)[:, None]
    return arc, np.vstack([np.zeros(2), np.cumsum(step, axis=0)]), np.interp(arc, knot_arc, knot_heading)
