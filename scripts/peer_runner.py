"""Run other programs on samples: started by `benchmark_peers.py` with the interpreter in which they are installed.

    PYTHON scripts/peer_runner.py NAME FOLDER

Each `FOLDER/input-N.npz` holds `t` (N,) s, `acc` (N, 3) m/s^2, `gyr` (N, 3) rad/s, `mag` (N, 3) uT, held from sample to
sample, `still` (N,), whether the foot stands, and `repeats`. What comes of it, `output-NAME-N.npz`, holds `quaternion`
(N, 4) xyzw of nav_R_body, z up; `position` (N, 3) m where there is one; `seconds` of the processor, the least of the
repeats, behind a first call that compiles; and `version`. Nothing of fg-nav is imported, and all parameters are the
defaults of the program.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np

G = 9.80665

Samples = dict[str, np.ndarray]
Run = tuple[Callable[[], object], Callable[..., Samples]]
"""What is timed, and what reads the result of it."""


def run_gaitmap(given: Samples, own_detector: bool) -> Run:
    """Gaitmap's error-state Kalman filter with RTS smoothing, from an attitude that the first stance levels."""
    import pandas as pd
    from gaitmap.base import BaseZuptDetector
    from gaitmap.trajectory_reconstruction import RtsKalman
    from scipy.spatial.transform import Rotation

    class GivenStances(BaseZuptDetector):
        """Stances that are known."""

        def __init__(self, still: np.ndarray) -> None:
            self.still = still

        def detect(self, data: object, **_: object) -> GivenStances:
            """Take them as they are."""
            self.per_sample_zupts_ = self.still
            edges = np.flatnonzero(np.diff(np.concatenate([[0], self.still.astype(int), [0]])))
            self.zupts_ = pd.DataFrame(edges.reshape(-1, 2), columns=["start", "end"])
            return self

    names = [f"{sensor}_{axis}" for sensor in ("acc", "gyr") for axis in "xyz"]
    data = pd.DataFrame(np.hstack([given["acc"], np.degrees(given["gyr"])]), columns=names)
    rate_hz = float(1.0 / np.median(np.diff(given["t"])))
    first = np.flatnonzero(given["still"])[: max(1, round(0.1 * rate_hz))]
    level, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [given["acc"][first].mean(axis=0)])
    more = {} if own_detector else {"zupt_detector": GivenStances(given["still"])}

    def run() -> object:
        return RtsKalman(initial_orientation=level, **more).estimate(data, sampling_rate_hz=rate_hz)

    def read(found: object) -> Samples:
        position, attitude = found.position_.to_numpy()[1:], found.orientation_object_[1:]  # behind each sample
        return {"position": position, "quaternion": attitude.as_quat()}

    return run, read


def run_vqf(given: Samples, offline: bool, with_field: bool) -> Run:
    """VQF, of the past alone or of all samples."""
    import vqf

    gyr, acc, mag = (np.ascontiguousarray(given[name]) for name in ("gyr", "acc", "mag"))
    period = float(np.median(np.diff(given["t"])))

    def run() -> object:
        if offline:
            return vqf.offlineVQF(gyr, acc, mag if with_field else None, period)
        return vqf.VQF(period).updateBatch(gyr, acc, mag if with_field else None)

    def read(found: object) -> Samples:
        return {
            "quaternion": np.roll(found["quat9D" if with_field else "quat6D"], -1, axis=1),
            "bias": np.asarray(found["bias"]),
        }

    return run, read


def run_imufusion(given: Samples, with_field: bool) -> Run:
    """Fusion's complementary filter behind its estimate of the gyroscope's bias, as its example has it."""
    import imufusion

    rate_hz = float(1.0 / np.median(np.diff(given["t"])))
    gyr, acc, mag = np.degrees(given["gyr"]), given["acc"] / G, given["mag"]

    def run() -> object:
        filter_of, bias = imufusion.Ahrs(), imufusion.Bias()
        of_bias, of_filter = imufusion.BiasSettings(), imufusion.AhrsSettings()
        of_bias.sample_rate = of_filter.sample_rate = rate_hz
        bias.set_settings(of_bias)
        filter_of.set_settings(of_filter)
        filter_of.set_sample_period(1.0 / rate_hz)
        attitude, offset = np.empty((len(gyr), 4)), np.empty((len(gyr), 3))
        for k in range(len(gyr)):
            rate = bias.update(gyr[k])
            if with_field:
                filter_of.update(rate, acc[k], mag[k])
            else:
                filter_of.update_no_magnetometer(rate, acc[k])
            attitude[k], offset[k] = filter_of.get_quaternion(), bias.get_offset()
        return attitude, offset

    def read(found: tuple[np.ndarray, np.ndarray]) -> Samples:
        return {"quaternion": np.roll(found[0], -1, axis=1), "bias": np.radians(found[1])}

    return run, read


RUNS = {
    "gaitmap": lambda given: run_gaitmap(given, True),
    "gaitmap, our stances": lambda given: run_gaitmap(given, False),
    "vqf": lambda given: run_vqf(given, False, True),
    "vqf, 6D": lambda given: run_vqf(given, False, False),
    "vqf offline": lambda given: run_vqf(given, True, True),
    "vqf offline, 6D": lambda given: run_vqf(given, True, False),
    "imufusion": lambda given: run_imufusion(given, True),
    "imufusion, 6D": lambda given: run_imufusion(given, False),
}
"""By name; the word before a comma or a space is the package's."""


def main() -> None:
    """Run on all inputs of a folder."""
    name, folder = sys.argv[1], Path(sys.argv[2])
    package = name.replace(",", " ").split()[0]
    for source in sorted(folder.glob("input-*.npz")):
        given = dict(np.load(source))
        run, read = RUNS[name](given)
        found = run()
        seconds = []
        for _ in range(int(given["repeats"])):
            began = time.process_time()
            found = run()
            seconds.append(time.process_time() - began)
        target = folder / source.name.replace("input", f"output-{name}")
        np.savez(target, seconds=min(seconds), version=version(package), **read(found))


if __name__ == "__main__":
    main()
