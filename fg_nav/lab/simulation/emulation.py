"""Other fields for a walk that was simulated already, as Munoz Diaz et al. (2017) emulate them (Figure 3).

They record a walk once with a fibre-optic gyroscope and compute what a magnetometer would have read along it,

    mu = C^T H + v_mu                                                               MD (18)

C being the attitude and H the field in nav at the place. So the field is all that differs between experiments: rates
and specific forces are the same to the last bit. Here attitude and place are the truth's.

A street's field jumps where one cylinder's cell ends and the next begins (`fg_nav.lab.simulation.fields.cylinder`). The
paper takes no difference across such a border (2.2); here there is no field for a while after it, longer than the
filter's longest difference (`fg_nav.pocket.parameters`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields import Cylinders, Field, Sum
from fg_nav.lab.simulation.walk import SimulatedWalk
from fg_nav.recording import Recording, TrajectoryTruth

BORDER_S = 0.3
"""For so long after a border there is no field."""


def replace_field(
    walk: SimulatedWalk, field: Field | None, noise_sd_uT: float, rng: np.random.Generator, border_s: float = BORDER_S
) -> Recording:
    """The recording of a walk with the magnetometer that it would have had in another field.

    Parameters
    ----------
    walk : rates, specific forces, and the true pose at each sample.
    field : by places in the course's frame, as `walk.field` is; None for no magnetometer.
    noise_sd_uT : v_mu, white, of a sample and axis.
    rng : source of the noise.
    border_s : how long there is no field after a border between two cells of a street; 0 leaves the jump in.

    Raises `SimulationError` if the recording has no true attitude, or the walk leads through iron.
    """
    recording = walk.recording
    truth = recording.truth
    if not isinstance(truth, TrajectoryTruth) or truth.nav_R_body is None:
        raise SimulationError("there is no true attitude to compute a field with: use a simulated walk as it comes.")
    if field is None:
        return replace(recording, mag=None)
    place = truth.position + walk.origin
    mag = np.einsum("nji,nj->ni", truth.nav_R_body, field.at(place))
    mag += noise_sd_uT * rng.standard_normal(mag.shape)
    mag[mark_borders(recording.t, place, field, border_s)] = np.nan
    return replace(recording, mag=mag)


def mark_borders(t: Floats, position: Floats, field: Field, border_s: float = BORDER_S) -> Bools:
    """(N,) True where less than `border_s` ago at `position` (N, 3) m one came into another cylinder's cell."""
    inside = np.zeros(len(t), dtype=np.bool_)
    for street in _streets(field):
        cell = street.cell(position)
        crossed = np.flatnonzero(np.diff(cell) != 0) + 1
        since = t - np.concatenate([[-np.inf], t[crossed]])[np.searchsorted(crossed, np.arange(len(t)), side="right")]
        inside |= since < border_s
    return inside


def _streets(field: Field) -> list[Cylinders]:
    if isinstance(field, Sum):
        return [street for part in field.parts for street in _streets(part)]
    return [field] if isinstance(field, Cylinders) else []
