"""What the preintegration of GTSAM leaves behind at the end of a stride, on a foot whose motion is known exactly.

    python scripts/preintegration.py

The noise-free samples of the simulated demonstration, a minute of walking, are cut at the middle of each stance. Each
stride is preintegrated from the true state at its start, by GTSAM's default class and by the Galilean one, and the
velocity it predicts at the end is compared with the true one. Nothing but the integration can be wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import figures as fig
import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Person, courses
from fg_nav.lab.simulation.foot import FootMotion, foot_motion
from fg_nav.lab.simulation.motion import Kinematics
from fg_nav.lab.simulation.person import INSTEP
from fg_nav.lab.simulation.plan import plan

CLASSES: Mapping[str, Any] = {
    "default (tangent space)": gtsam.PreintegratedImuMeasurements,
    "Galilean": gtsam.PreintegratedImuMeasurementsG,
}

RATES_HZ = (100.0, 200.0, 400.0)


def main() -> None:
    """Print the velocity error at the end of a stride, root mean square over the strides."""
    motion = demo_motion(np.random.default_rng(1))
    errors = [stride_errors(motion, rate_hz) for rate_hz in RATES_HZ]
    rows = [[name, *(f"{1e3 * _rms(error[name]):.2f}" for error in errors)] for name in CLASSES]
    fig.print_heading("Velocity error at the end of a stride, rms (mm/s)")
    fig.print_table(("preintegration", *(f"{rate_hz:g} Hz" for rate_hz in RATES_HZ)), rows)
    print(f"{len(errors[0]['Galilean'])} strides")


def demo_motion(rng: np.random.Generator) -> FootMotion:
    """A sensor on the default person's instep, once round the corridor."""
    person = Person()
    return foot_motion(plan(courses.demo(), person, rng), person, INSTEP, rng)


def stride_errors(motion: FootMotion, rate_hz: float) -> dict[str, Floats]:
    """Predicted less true velocity (S, 3) m/s at the end of each stride, by class."""
    cuts: Ints = (motion.flat.mean(axis=1) * rate_hz).astype(np.int64)
    t = np.arange(cuts[-1] + 1) / rate_hz
    samples, truth = motion.sampled(t, 1 / rate_hz), motion.at(t)
    strides = list(pairwise(cuts))
    return {
        name: np.array([_predicted(kind, samples, truth, i, j, rate_hz) - truth.velocity[j] for i, j in strides])
        for name, kind in CLASSES.items()
    }


def _predicted(kind: Any, samples: tuple[Floats, Floats], truth: Kinematics, i: int, j: int, rate_hz: float) -> Floats:
    params = gtsam.PreintegrationParams.MakeSharedU(GRAVITY_M_S2)
    measurement = kind(params)
    for rate, force in zip(samples[0][i:j], samples[1][i:j], strict=True):
        measurement.integrateMeasurement(force, rate, 1 / rate_hz)
    start = gtsam.NavState(gtsam.Rot3(truth.nav_R_body[i]), truth.position[i], truth.velocity[i])
    end = measurement.predict(start, gtsam.imuBias.ConstantBias())
    return np.asarray(end.velocity())


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


if __name__ == "__main__":
    fig.leave_with(main)
