"""Surveyed walks of gdlbio: MATLAB files of a LORD 3DM-GX5-25 on a shoe.

=================== ======== ============================================================================
`imu_data`          (N, 6)   acc m/s^2, gyr rad/s
`timestamps`        (N,)     s
`strideIndex`       (M,)     sample (from 0) in each stance of the shoe; the first is the start of the walk
`GCP`               (M, 2)   m, footprint of each of them, **left-handed** seen from above: y is negated here
`pyshoeTrajectory`  (N, 2)   m, path by PyShoe as the authors of the set ran it, left-handed as well
=================== ======== ============================================================================

Footprints are surveyed one a stride, and `strideIndex` says when the shoe stood on each: they are matched in time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, Variables, load_mat, mat_array, mat_samples, read_content
from fg_nav.io.truth import pack_footprints
from fg_nav.recording import Provenance, RawRecording
from fg_nav.truth import FootprintTruth

_RIGHT_HANDED = np.array([1.0, -1.0])


def recognizes(content: Content) -> bool:
    """Whether the file holds a variable `imu_data`, or the samples of the stances that go with it."""
    return not {"imu_data", "strideIndex"}.isdisjoint(content.variables)


def read(content: Content) -> RawRecording:
    """Read a surveyed walk.

    Raises `FormatError` if a variable is missing, damaged, or does not fit the others; footprints may be absent.
    """
    path = content.path
    variables = load_mat(content)
    t, acc, gyr = mat_samples(variables, "imu_data", "timestamps", path)
    return RawRecording(
        t=t,
        acc=acc,
        gyr=gyr,
        row=np.arange(1, len(t) + 1),
        truth=_footprints(variables, t, path),
        provenance=Provenance(path=path, format="gdlbio"),
    )


def read_pyshoe_track(path: Path | str) -> Floats:
    """Path (N, 2) m, right-handed, that the authors of the set had from PyShoe, at every sample of the file.

    Raises `FormatError` if the file is no MATLAB file or does not hold it.
    """
    path = Path(path)
    track = mat_array(load_mat(read_content(path)), "pyshoeTrajectory", path, columns=2)
    return np.asarray(track * _RIGHT_HANDED)


def _footprints(variables: Variables, t: Floats, path: Path) -> FootprintTruth | None:
    if not {"strideIndex", "GCP"} <= variables.keys():
        return None
    xy = mat_array(variables, "GCP", path, columns=2) * _RIGHT_HANDED
    sample = _read_samples(variables, len(t), path)
    if len(sample) != len(xy):
        raise FormatError(f"{path.name} has {len(xy)} footprints but {len(sample)} stances: export it again.")
    return pack_footprints(np.arange(len(xy), dtype=np.float64), xy, len(xy) - 1, path, t[sample])


def _read_samples(variables: Variables, n_samples: int, path: Path) -> Ints:
    """Samples of the stances, which rise."""
    sample = mat_array(variables, "strideIndex", path)
    whole = ((sample >= 0) & (sample < n_samples) & (sample == np.round(sample))).all()
    if not whole or (np.diff(sample) <= 0).any():
        raise FormatError(f"{path.name}: 'strideIndex' must be rising samples of the recording: export it again.")
    return sample.astype(np.int64)
