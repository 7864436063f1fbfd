"""What the exports of all Xsens and Movella sensors have in common: names, and samples given as increments.

`Acc_X`, `Gyr_X` and `Mag_X` ... are samples. Where they are absent, the changes of velocity (m/s) and the turns
(quaternions) over each sample do as well: over the period of a sample they are the mean specific force and rate, which
is what strapdown integration needs. `FreeAcc` is without gravity and in another frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import FormatError
from fg_nav.io.delimited import Header
from fg_nav.io.text_columns import drop_held, scale_values
from fg_nav.samples.plausibility import is_field_on_earth, measure_field_strength, median_period_s

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

ACC, GYR, MAG = (tuple(f"{sensor}_{axis}" for axis in "XYZ") for sensor in ("Acc", "Gyr", "Mag"))
_VELOCITIES = (("dv[1]", "dv[2]", "dv[3]"), tuple(f"VelInc_{axis}" for axis in "XYZ"))
TURN = ("dq_W", "dq_X", "dq_Y", "dq_Z")
_TURNS = (TURN, tuple(f"OriInc_q{k}" for k in range(4)), tuple(f"OriInc_{axis}" for axis in "wxyz"))


class Inertial(NamedTuple):
    """Names of the columns of specific force (3,) and of the rate of turn (3,), or (4,) where it comes as turns."""

    acc: tuple[str, ...]
    gyr: tuple[str, ...]

    def to_samples(self, acc: Floats, gyr: Floats, t: Floats) -> tuple[Floats, Floats, tuple[str, ...]]:
        """Specific force in m/s^2, rate in the unit of the file or in rad/s, and what was done."""
        per_s = 1.0 / median_period_s(t)
        remarks = []
        if self.acc != ACC:
            acc = scale_values(acc, per_s)
            remarks.append("the specific force is from the changes of velocity over each sample")
        if self.gyr != GYR:
            gyr = scale_values(find_turns(gyr), per_s)
            remarks.append("the rate of turn is from the turns over each sample")
        return acc, gyr, tuple(remarks)


def find_inertial(header: Header, path: Path) -> Inertial:
    """Find the columns of specific force and rate.

    Raises `FormatError` if there are none of one of them.
    """
    acc = _find_group(header, (ACC, *_VELOCITIES))
    gyr = _find_group(header, (GYR, *_TURNS))
    if acc and gyr:
        return Inertial(acc, gyr)
    what = [*(() if acc else ("accelerometer",)), *(() if gyr else ("gyroscope",))]
    names = [*(() if acc else ("Acc_X, _Y, _Z",)), *(() if gyr else ("Gyr_X, _Y, _Z",))]
    removed = " (FreeAcc is without gravity)" if "FreeAcc_X" in header and not acc else ""
    raise FormatError(
        f"{path.name} has no {' and no '.join(what)}{removed}: export it again with the inertial data "
        f"({' and '.join(names)})."
    )


def _find_group(header: Header, groups: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """Find the first group of which a column is there; if one is missing, reading it says which."""
    return next((group for group in groups if not set(group).isdisjoint(header.names)), ())


def find_turns(wxyz: Floats) -> Floats:
    """Rotation vectors (N, 3) rad of quaternions (N, 4); NaN where they are not of unit length."""
    rotation, known = find_rotations(wxyz)
    turned = np.asarray(rotation.as_rotvec())
    turned[~known] = np.nan
    return turned


def find_rotations(wxyz: Floats) -> tuple[Rotation, Bools]:
    """Rotations of quaternions (N, 4), and which (N,) are of unit length; the others are none."""
    known = np.zeros(len(wxyz), dtype=np.bool_)
    small = (np.abs(wxyz) < 2.0).all(axis=1)
    known[small] = np.abs(np.linalg.norm(wxyz[small], axis=1) - 1.0) < 0.01
    from scipy.spatial.transform import Rotation  # slow to load

    return Rotation.from_quat(np.where(known[:, None], wxyz, [1.0, 0.0, 0.0, 0.0]), scalar_first=True), known


LOCAL_FIELD_UT = 48.0  # One unit of the local field: 25 to 65 uT on Earth, 48 in most of Europe and North America.


def scale_local_field(mag: Floats | None, gyr: Floats) -> tuple[Floats | None, tuple[str, ...]]:
    """Return a magnetometer (N, 3) in units of the local field in uT, held samples left out, and what is said of it.

    `gyr` (N, 3) is in rad/s. The direction, and changes over a walk, are what a path has of it: not the strength.
    """
    if mag is None or not mag.size:
        return None, ()
    median = float(np.nanmedian(measure_field_strength(mag))) if np.isfinite(mag).any() else np.nan
    said = f"the magnetometer is in units of the local field (median {median:.2f})"
    if not is_field_on_earth(LOCAL_FIELD_UT * median):
        return None, (f"{said}, of which it is none: left out",)
    return drop_held(scale_values(mag, LOCAL_FIELD_UT), gyr), (f"{said}: 1 is taken for {LOCAL_FIELD_UT:.0f} uT",)
