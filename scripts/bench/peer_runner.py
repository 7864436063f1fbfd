"""Run another program on samples: started by `experiments/cost.py` with the interpreter in which it is installed.

    PYTHON scripts/bench/peer_runner.py NAME FOLDER

`FOLDER/input.npz` holds `t` (N,) s, `acc` (N, 3) m/s^2, `gyr` (N, 3) rad/s, `mag` (N, 3) uT, held from sample to
sample, `still` (N,), whether the foot stands, and `repeats`. What comes of it, `output.npz`: `quaternion` (N, 4)
xyzw of nav_R_body, z up; `position` (N, 3) m where there is one; and `seconds` of the processor, the least of the
repeats, behind a first call that compiles. Nothing of fg-nav is imported, and all parameters are defaults.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Run = Callable[[], dict[str, Any]]


def run_gaitmap(t: Any, acc: Any, gyr: Any, mag: Any, still: Any, own_detector: bool) -> Run:
    """Gaitmap's error-state Kalman filter with RTS smoothing, from an attitude that the first stance levels."""
    import pandas as pd
    from gaitmap.base import BaseZuptDetector
    from gaitmap.trajectory_reconstruction import RtsKalman
    from scipy.spatial.transform import Rotation

    class GivenStances(BaseZuptDetector):
        """Stances that are known."""

        def detect(self, data: object, **_: object) -> GivenStances:
            """Take them as they are."""
            self.per_sample_zupts_ = still
            edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
            self.zupts_ = pd.DataFrame(edges.reshape(-1, 2), columns=["start", "end"])
            return self

    names = [f"{sensor}_{axis}" for sensor in ("acc", "gyr") for axis in "xyz"]
    data, rate_hz = pd.DataFrame(np.hstack([acc, np.degrees(gyr)]), columns=names), float(1.0 / np.median(np.diff(t)))
    first = np.flatnonzero(still)[: max(1, round(0.1 * rate_hz))]
    level, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [acc[first].mean(axis=0)])
    more = {} if own_detector else {"zupt_detector": GivenStances()}

    def run() -> dict[str, Any]:
        found = RtsKalman(initial_orientation=level, **more).estimate(data, sampling_rate_hz=rate_hz)
        # States stand behind each sample.
        return {"position": found.position_.to_numpy()[1:], "quaternion": found.orientation_object_[1:].as_quat()}

    return run


def run_vqf(t: Any, acc: Any, gyr: Any, mag: Any, still: Any, offline: bool) -> Run:
    """VQF with the magnetometer, of the past alone or of all samples."""
    import vqf

    gyr, acc, mag = (np.ascontiguousarray(one) for one in (gyr, acc, mag))
    period = float(np.median(np.diff(t)))

    def run() -> dict[str, Any]:
        found = vqf.offlineVQF(gyr, acc, mag, period) if offline else vqf.VQF(period).updateBatch(gyr, acc, mag)
        return {"quaternion": np.roll(found["quat9D"], -1, axis=1)}

    return run


RUNS: dict[str, Callable[..., Run]] = {
    "gaitmap": lambda **given: run_gaitmap(**given, own_detector=True),
    "gaitmap, our stances": lambda **given: run_gaitmap(**given, own_detector=False),
    "vqf": lambda **given: run_vqf(**given, offline=False),
    "vqf offline": lambda **given: run_vqf(**given, offline=True),
}

if __name__ == "__main__":
    folder, given = Path(sys.argv[2]), dict(np.load(Path(sys.argv[2]) / "input.npz"))
    repeats, seconds = int(given.pop("repeats")), list[float]()
    run = RUNS[sys.argv[1]](**given)
    found = run()
    for _ in range(repeats):
        began = time.process_time()
        found = run()
        seconds.append(time.process_time() - began)
    np.savez(folder / "output.npz", seconds=min(seconds), **found)
