"""Samples to inertial measurements between nodes.

Galilean preintegration: each sample is held over its own period, and a constant body rate and specific force are
integrated exactly; the default preintegration of GTSAM is first order in the period, and its error on a swinging foot
looks like a yaw bias. The noise of an interval is the mean over its samples of

    s_a^2 = density^2 + (relative (|f| - g))^2,     s_w^2 = density^2 + (relative |w|)^2,

and the interval gets the same total as from a noise set sample by sample. What is doubted more, on an axis at the end
of its range and before a gap (`fg_nav.sample_noise`), is so at its own sample: a force that was hidden when the foot
pushed off moves the end of its swing, and one that was hidden when it came down does not. A gap is integrated in steps
of the sample period: within a step, what turns does not yet move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.recording import Recording
from fg_nav.sample_noise import find_extra_sigmas
from fg_nav.smoother.parameters import SmootherParameters


def preintegrate(
    recording: Recording,
    sample: Ints,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
) -> Iterator[gtsam.PreintegratedImuMeasurementsG]:
    """Yield the measurement from each node to the next, for nodes at `sample` (M,), linearised at `bias`."""
    acc_noise, gyr_noise = _interval_variances(recording, sample, p)
    doubt = [size**2 for size in find_extra_sigmas(recording, p.saturated_share)]
    doubted = np.concatenate([[0], np.cumsum((doubt[0] + doubt[1]).any(axis=1))])[sample]
    period = np.diff(recording.t).tolist()
    force, rate = recording.integrable
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(np.eye(3) * p.position_density**2)
    for k, (i, j) in enumerate(pairwise(sample)):
        params.setAccelerometerCovariance(np.diag(acc_noise[k]))
        params.setGyroscopeCovariance(np.diag(gyr_noise[k]))
        measurement = gtsam.PreintegratedImuMeasurementsG(params, bias)
        integrate = measurement.integrateMeasurement
        samples = zip(force[i:j], rate[i:j], period[i:j], strict=True)
        if doubted[k] == doubted[k + 1]:
            for acc, gyr, h in samples:
                integrate(acc, gyr, h)
        else:
            for (acc, gyr, h), acc_doubt, gyr_doubt in zip(samples, doubt[0][i:j], doubt[1][i:j], strict=True):
                params.setAccelerometerCovariance(np.diag(acc_noise[k] + acc_doubt * h))
                params.setGyroscopeCovariance(np.diag(gyr_noise[k] + gyr_doubt * h))
                steps = max(1, round(h / recording.period_s))
                for _ in range(steps):
                    integrate(acc, gyr, h / steps)
        if progress is not None and k % 64 == 0:
            progress(k / len(sample))
        yield measurement


def _interval_variances(recording: Recording, sample: Ints, p: SmootherParameters) -> tuple[Floats, Floats]:
    """Squared noise densities (M-1, 3) of specific force and rate in each interval, without what is doubted."""
    off_gravity = np.linalg.norm(recording.acc, axis=1) - p.gravity
    rate_squared = (recording.gyr**2).sum(axis=1)
    acc = p.acc_density**2 + (p.acc_relative_density * off_gravity) ** 2
    gyr = np.radians(p.gyr_density_deg_s) ** 2 + p.gyr_relative_density**2 * rate_squared
    h = np.append(np.diff(recording.t), recording.period_s)
    acc, gyr = (np.repeat(variance[:, None], 3, axis=1) for variance in (acc, gyr))
    return _means(acc, h, sample), _means(gyr, h, sample)


def _means(values: Floats, h: Floats, sample: Ints) -> Floats:
    """Mean (M-1, 3) over the time from each node to the next of values (N, 3), each held for `h` (N,) seconds."""
    total = np.vstack([np.zeros(3), np.cumsum(values * h[:, None], axis=0)])
    elapsed = np.concatenate([[0.0], np.cumsum(h)])
    return np.asarray(np.diff(total[sample], axis=0) / np.diff(elapsed[sample])[:, None])
