"""Magnetic heading: the horizontal part of the field points to magnetic north, and nothing is said about tilt.

Navigation frame East-North-Up; y is the field in the body frame, uT, calibrated. Turned into the navigation frame it is

    m = nav_R_body y = (m_E, m_N, m_U),     azimuth = atan2(m_E, m_N), clockwise from north.

The field points to magnetic north, whose azimuth is the declination D (rad, east positive). The residual is

    e = wrap(azimuth - D),

which is the heading that the attitude claims minus the heading that the field shows: with an attitude turned too far
clockwise, the field seems turned clockwise by as much. (Ma 2018 Eq. 1 and Zhang Eq. 25 print the other sign of the
levelled y component: with it an error doubles where it should cancel.)

A turn of the body by d (body frame) changes m by (nav_R_body d) x m. About up, this lowers the azimuth by the angle:

    de/dpose = [-e_z^T nav_R_body, 0].

About the horizontal axes the azimuth would change as well, by tan(inclination) times the tilt, more than twice the
tilt in Europe. That part is left out on purpose: the field indoors is no plumb line, and must not tilt the attitude.
The factor informs of the rotation about up and of nothing else; the tilt's error belongs in the noise.

Left out of the Jacobian alone, this makes the error depend on what no step minimises, and a solver that compares errors
may refuse a good step. `nav_R_level`, the attitude at the last linearisation, settles it: the field is levelled by it,
and only the turn about up from it to nav_R_body counts,

    e = wrap(azimuth(nav_R_level y) - D - turn),     turn = twist about up of nav_R_body nav_R_level^T,

of which the row above is the derivative at equal tilt. Without it the field is levelled by nav_R_body itself.
"""

import gtsam
import numpy as np

from .guarded import Array, guarded_factor
from .rotation import turn_about_up


def magnetic_heading_residual(
    nav_R_body: Array, body_field: Array, declination: Array | float, nav_R_level: Array | None = None
) -> Array:
    """Residual (...,) rad of attitudes (..., 3, 3), fields (..., 3) uT and declinations (...,) rad, east positive."""
    level = nav_R_body if nav_R_level is None else nav_R_level
    nav_field = np.einsum("...ab,...b->...a", level, body_field)
    e = np.arctan2(nav_field[..., 0], nav_field[..., 1]) - declination
    if nav_R_level is not None:
        e = e - turn_about_up(nav_R_body @ np.swapaxes(nav_R_level, -1, -2))
    return np.asarray((e + np.pi) % (2.0 * np.pi) - np.pi)


def magnetic_heading_jacobian(nav_R_body: Array) -> Array:
    """Derivative (..., 3) of the residual by the rotation of the pose, for turns about up: -e_z^T nav_R_body."""
    return np.asarray(-nav_R_body[..., 2, :])


def heading_sigma(
    horizontal_uT: Array | float,
    field_sigma_uT: Array | float,
    vertical_uT: Array | float = 0.0,
    tilt_sigma: Array | float = 0.0,
) -> Array:
    """Sigma (...,) rad of the azimuth of a field.

    Parameters
    ----------
    horizontal_uT, vertical_uT
        Of the field that is there. A weak horizontal field shows the way badly; none at all: infinity.
    field_sigma_uT
        On each horizontal axis, of the sensor and of the surroundings.
    tilt_sigma : rad
        Of the attitude that levels it, on each horizontal axis; it turns part of the vertical field to the side.
    """
    side = np.hypot(field_sigma_uT, np.multiply(vertical_uT, tilt_sigma))
    with np.errstate(divide="ignore"):
        return np.asarray(side / np.asarray(horizontal_uT, dtype=np.float64))


def magnetic_heading_factor(
    pose_key: int,
    body_field: Array,
    declination: float,
    noise: gtsam.noiseModel.Base,
    nav_R_level: Array | None = None,
) -> gtsam.CustomFactor:
    """Tie the heading of a pose to the magnetic north that its field shows.

    Parameters
    ----------
    pose_key
        Key of nav_T_body (Pose3).
    body_field : (3,) uT
        Mean over a stance, calibrated.
    declination : rad
        East positive.
    noise
        Of dimension 1, rad (`heading_sigma`).
    nav_R_level : (3, 3), optional
        Attitude that levels the field; by default the one of the pose as it is.
    """
    y = np.array(body_field, dtype=np.float64)
    level = None if nav_R_level is None else np.array(nav_R_level, dtype=np.float64)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        nav_R_body = values.atPose3(pose_key).rotation().matrix()
        e = np.atleast_1d(magnetic_heading_residual(nav_R_body, y, declination, level))
        if not with_jacobians:
            return e, []
        by_pose = np.zeros((1, 6))
        by_pose[0, :3] = magnetic_heading_jacobian(nav_R_body)
        return e, [by_pose]

    return guarded_factor("magnetic heading", [pose_key], [6], noise, residual)
