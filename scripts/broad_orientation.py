"""Orientation of the pocket's estimators beside VQF's, on hand-moved trials with an optical truth (BROAD).

    python scripts/broad_orientation.py [--data DIR] [--trials NAME ...] [--json FILE]

Six trials of one sensor at 286 Hz: slow and fast rotations, tapping, a magnet that lies about, one on the sensor. None
is a walk. With the true rotation nav_R_true and the estimated one, the error is nav_R_est nav_R_true^T = (w, x, y, z)
as a quaternion, and in motion phases (Laidig 2021)

============ ======================================================================================================
total        rms of its angle, deg
inclination  rms of 2 acos sqrt(w^2 + z^2), deg: how far up is off
heading      rms of 2 atan2(z, w), deg
bias         rms of the length of what the estimated gyro bias is off the mean rate of the rest phases, deg/s
============ ======================================================================================================

The heading is relative: its circular mean over the motion phases is taken off first, for each method alike. Magnetic
north is not the cameras', and the pocket begins with a heading of zero.

Methods that know all of the trial: VQF offline and `smooth_pocket`. Those that know the past alone: VQF,
`follow_pocket` and the paper's filter, `estimate_pocket`. VQF has the magnetometer (9D) and its default parameters, and
so have ours, but for the magnetometer's noise, which the first rest shows. Nothing is fitted to the truth; but that a
magnetometer keeps an error of its attitude, and a gyroscope one of its scale, was seen on these trials, in what the
graph found for the scale: one sensor's ought to be the same in each.

VQF takes a rate for the mean over the period before its stamp, ours for that of the period after it. By the cameras
those of all six trials are of 1.1 samples before the stamp, so ours too are given them as of the period before
(`hold_rates`). At 650 deg/s a sample is 2.3 deg.

Reference: Laidig, Caruso, Cereatti, Seel (2021), "BROAD: A Benchmark for Robust Inertial Orientation Estimation",
Data 6(7) 72; Laidig, Seel (2023), "VQF", Information Fusion 91.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import FormatError, OutputError
from fg_nav.io import read
from fg_nav.io.content import read_content
from fg_nav.io.matlab import mat_array
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.pocket.filter import PocketParameters, estimate_pocket
from fg_nav.pocket.iterated_smoother import PocketSmootherParameters, smooth_pocket
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording

VQF_OFFLINE, VQF_ONLINE, BATCH, CAUSAL, PAPER = "VQF offline", "VQF online", "batch", "causal", "paper's filter"
BESIDE = {BATCH: VQF_OFFLINE, CAUSAL: VQF_ONLINE, PAPER: VQF_ONLINE}  # Ours, and which VQF knows as much.

MEASURES = ("total", "inclination", "heading", "bias")

_PART_S = 0.5  # Means of the field over so long are those of a node of the graph.


@dataclass(frozen=True)
class Trial:
    """A trial: its recording, `field` (N, 3) uT as logged, held samples and all, `nav_R_true`, and its phases.

    `moving` (N,) where it is moved and the cameras see it; `resting` (N,); `rate` Hz.
    """

    name: str
    recording: Recording
    field: Floats
    nav_R_true: Rotation
    moving: Bools
    resting: Bools
    rate: float

    @property
    def bias(self) -> Floats:
        """Mean rate (3,) of the rest phases, rad/s. The Earth's, 0.004 deg/s, is in it, and in all estimates."""
        return np.asarray(self.recording.gyr[self.resting].mean(axis=0))


@dataclass(frozen=True)
class Estimate:
    """`nav_R_body`, N of them, and `bias` (N, 3) rad/s."""

    nav_R_body: Rotation
    bias: Floats


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        trials=harness.option(None, "those whose names begin so, such as 01", nargs="+", metavar="NAME"),
        json=None,
    )
    trials = read_trials(walks.data_folder(chosen.data), chosen.trials)
    found = {trial.name: measure_trial(trial) for trial in trials}
    figures = figures_of(found)
    print_all(trials, found, figures)
    if chosen.json is not None:
        harness.write_json(chosen.json, {"trials": found, "mean": [figure.as_dict() for figure in figures]})


def read_trials(data: Path, names: Sequence[str] | None = None) -> list[Trial]:
    """Load the trials, all or those whose names begin so."""
    paths = sorted((data / "broad").glob("*.mat"))
    some = [path for path in paths if names is None or path.name.startswith(tuple(names))]
    if not some:
        raise OutputError(f"{data} holds no such BROAD trial: name another folder, or other trials.")
    return [read_trial(path) for path in some]


def read_trial(path: Path) -> Trial:
    """Load a trial."""
    recording, variables = read(path), read_content(path).load_variables()
    wxyz = mat_array(variables, "opt_quat", path, columns=4)
    moved = mat_array(variables, "movement", path).astype(bool)
    if not len(wxyz) == len(moved) == len(recording):
        raise FormatError(f"{path.name}: samples were left out of it, so that its truth does not fit: export it again.")
    seen = np.isfinite(wxyz).all(axis=1)
    return Trial(
        name=path.stem,
        recording=recording,
        field=mat_array(variables, "imu_mag", path, columns=3),
        nav_R_true=Rotation.from_quat(np.where(seen[:, None], wxyz, [1.0, 0.0, 0.0, 0.0]), scalar_first=True),
        moving=moved & seen,
        resting=~moved,
        rate=float(mat_array(variables, "sampling_rate", path)[0]),
    )


def measure_trial(trial: Trial) -> dict[str, dict[str, float]]:
    """Return the measures of all methods."""
    return {name: errors_of(trial, estimate) for name, estimate in run_methods(trial).items()}


def run_methods(trial: Trial) -> dict[str, Estimate]:
    """Run all methods."""
    sigma = field_sigma_uT(trial)
    graph, paper = PocketSmootherParameters(mag_sigma_uT=sigma), PocketParameters(mag_sigma_uT=sigma)
    held = hold_rates(trial.recording)
    return {
        **run_vqf(trial),
        BATCH: _kept(smooth_pocket(held, graph)),
        CAUSAL: _kept(follow_pocket(held, graph)),
        PAPER: _kept(estimate_pocket(held, paper)),
    }


def hold_rates(recording: Recording) -> Recording:
    """Rates of the period before a stamp as those of the period after the last stamp."""
    return replace(recording, gyr=np.concatenate([recording.gyr[1:], recording.gyr[-1:]]))


def run_vqf(trial: Trial) -> dict[str, Estimate]:
    """Run VQF offline and online, with the magnetometer and default parameters."""
    import vqf  # outside of the package: installed where this is measured

    gyr, acc, mag = (np.ascontiguousarray(x) for x in (trial.recording.gyr, trial.recording.acc, trial.field))
    period = 1.0 / trial.rate
    results: dict[str, Mapping[str, Any]] = {
        VQF_OFFLINE: vqf.offlineVQF(gyr, acc, mag, period),
        VQF_ONLINE: vqf.VQF(period).updateBatch(gyr, acc, mag),
    }
    return {k: Estimate(Rotation.from_quat(r["quat9D"], scalar_first=True), r["bias"]) for k, r in results.items()}


def _kept(track: PocketTrack) -> Estimate:
    return Estimate(Rotation.from_matrix(track.nav_R_body), track.gyro_bias)


def field_sigma_uT(trial: Trial) -> float:
    """White error of a field sample by the first rest, uT an axis.

    Neighbours are not independent (the sensor filters): from one half second's mean to the next it is what samples
    would have to have that are. The median leaves out what was moved about.
    """
    rest = slice(0, int(np.argmin(trial.resting)))
    mag = trial.recording.mag
    assert mag is not None
    fresh = mag[rest][np.isfinite(mag[rest]).all(axis=1)]
    per_mean = round(_PART_S * trial.rate * len(fresh) / (rest.stop - rest.start))
    means = fresh[: len(fresh) // per_mean * per_mean].reshape(-1, per_mean, 3).mean(axis=1)
    of_mean = 1.4826 * np.median(np.abs(np.diff(means, axis=0))) / np.sqrt(2.0)
    return float(of_mean * np.sqrt(per_mean))


def errors_of(trial: Trial, estimate: Estimate) -> dict[str, float]:
    """Return the measures of one estimate."""
    of, true = estimate.nav_R_body[trial.moving], trial.nav_R_true[trial.moving]
    offset = np.angle(np.exp(1j * heading_error(of * true.inv())).mean())
    error = Rotation.from_rotvec([0.0, 0.0, -offset]) * of * true.inv()
    x, y, z, w = error.as_quat().T
    return {
        "total": _rms_deg(error.magnitude()),
        "inclination": _rms_deg(2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))),
        "heading": _rms_deg(heading_error(error)),
        "bias": _rms_deg(np.linalg.norm(estimate.bias[trial.moving] - trial.bias, axis=1)),
    }


def heading_error(error: Rotation) -> Floats:
    """Heading (N,) rad of rotations in nav, counter-clockwise: of a turn about a level axis it is none."""
    _, _, z, w = error.as_quat(canonical=True).T
    return np.asarray(2.0 * np.arctan2(z, w))


def _rms_deg(x: Floats) -> float:
    return float(np.degrees(np.sqrt((x**2).mean())))


def figures_of(found: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[harness.Figure]:
    """Means over the trials; of ours it is asked to be no worse than VQF."""
    mean = {
        name: {m: float(np.mean([of[name][m] for of in found.values()])) for m in MEASURES}
        for name in next(iter(found.values()))
    }
    return [
        harness.Figure("mean", measure, name, mean[name][measure], high=mean[beside][measure])
        for name, beside in BESIDE.items()
        for measure in MEASURES
    ]


def print_all(
    trials: Sequence[Trial],
    found: Mapping[str, Mapping[str, Mapping[str, float]]],
    figures: Sequence[harness.Figure],
) -> None:
    """A table a trial, and the mean with what was asked."""
    for trial in trials:
        harness.print_heading(f"{trial.name}, magnetometer {field_sigma_uT(trial):.2f} uT a sample at rest")
        rows = [(name, *(f"{errors[m]:.3f}" for m in MEASURES)) for name, errors in found[trial.name].items()]
        harness.print_table(("rms: deg, bias deg/s", *MEASURES), rows)
    harness.print_heading("mean over the trials, asked: ours <= VQF's")
    harness.print_figures(figures)
    harness.print_verdict(figures)


if __name__ == "__main__":
    harness.run(main)
