"""From the samples between two nodes to one measurement, with the noise that the motion calls for.

Preintegration is Galilean: each sample is held over its own period, and a constant body rate and specific force are
integrated exactly; the default preintegration of GTSAM is first order in the period, and its error on a swinging foot
looks like a yaw bias. A dozen samples are handed over as two of the same motion (`compounding`). The noise of an
interval is the mean over its samples of

    s_a^2 = density^2 + (relative (|f| - g))^2,     s_w^2 = density^2 + (relative |w|)^2,

and the interval gets the same total as from a noise set sample by sample. What is less certain, on an axis at the end
of its range and before a gap (`fg_nav.sample_noise`), is so at its own sample: a force that was hidden when the foot
pushed off moves the end of its swing, and one that was hidden when it came down does not. A gap is integrated in steps
of the sample period: within a step, what turns does not yet move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import gtsam
import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.residual import one_of
from fg_nav.factors.unseen_walk import UnseenWalk
from fg_nav.recording import Recording
from fg_nav.sample_noise import find_extra_sigmas
from fg_nav.smoother.compounding import compound_samples
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.unseen import find_unseen_walks
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import drop_pages

POSITION_DENSITY = 1e-3
"""White error of velocity, m/s/sqrt(Hz): rounding of a sample's motion; keeps short intervals well conditioned."""

Measurement: TypeAlias = gtsam.PreintegratedImuMeasurementsG | UnseenWalk
"""From one node to the next: of the inertial sensor, or where its samples are missing what a person does."""


def preintegrate(
    recording: Recording,
    sample: Ints,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Measurement]:
    """Yield the measurement from each node to the next, for nodes at `sample` (M,), linearised at `bias`."""
    noise, extra = _interval_covariances(recording, sample, p), _ExtraNoise.of(recording, sample, p)
    unseen = find_unseen_walks(recording, sample, p.magnetic.compass)
    vector, h = bias.vector(), np.diff(recording.t)
    drop_pages()
    few = compound_samples(*recording.integrable, h, sample, vector[:3], vector[3:])
    drop_pages()
    held, begins = few.h.tolist(), few.first.tolist()
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(np.eye(3) * POSITION_DENSITY**2)
    for k, part in enumerate(pairwise(begins)):
        if progress is not None and k % 64 == 0:
            progress(k / len(sample))
        if unseen.unseen[k]:
            yield one_of(unseen.walk, k)
            continue
        params.setAccelerometerCovariance(noise[0][k])
        params.setGyroscopeCovariance(noise[1][k])
        measurement = gtsam.PreintegratedImuMeasurementsG(params, bias)
        if extra.uncertain[k]:
            extra.integrate(measurement, params, (noise[0][k], noise[1][k]), slice(sample[k], sample[k + 1]))
        else:
            rows = slice(*part)
            for one in zip(few.force[rows], few.rate[rows], held[rows], strict=True):
                measurement.integrateMeasurement(*one)
        yield measurement


@dataclass(frozen=True)
class _ExtraNoise:
    """The `sigma` (N, 3) of single samples, of force and rate, and which intervals (M-1,) have such samples."""

    recording: Recording
    sigma: tuple[Floats, Floats]
    uncertain: Bools

    @classmethod
    def of(cls, recording: Recording, sample: Ints, p: SmootherParameters) -> _ExtraNoise:
        acc, gyr = find_extra_sigmas(recording, p.saturated_share)
        count = np.append(0, np.cumsum(acc.any(axis=1) | gyr.any(axis=1)))
        return cls(recording, (acc, gyr), np.diff(count[sample]) > 0)

    def integrate(
        self,
        measurement: gtsam.PreintegratedImuMeasurementsG,
        params: gtsam.PreintegrationParams,
        noise: tuple[Floats, Floats],
        part: slice,
    ) -> None:
        """Integrate a part of the samples one by one, each with its variance and the noise (3, 3) of the interval."""
        force, rate = self.recording.integrable
        held, (acc_extra, gyr_extra) = np.diff(self.recording.t[part.start : part.stop + 1]), self.sigma
        for acc, gyr, h, more, more_gyr in zip(
            force[part], rate[part], held.tolist(), acc_extra[part] ** 2, gyr_extra[part] ** 2, strict=True
        ):
            params.setAccelerometerCovariance(noise[0] + np.diag(more * h))
            params.setGyroscopeCovariance(noise[1] + np.diag(more_gyr * h))
            steps = max(1, round(h / self.recording.period_s))
            for _ in range(steps):
                measurement.integrateMeasurement(acc, gyr, h / steps)


def _interval_covariances(recording: Recording, sample: Ints, p: SmootherParameters) -> tuple[Floats, Floats]:
    """Squared noise densities (M-1, 3, 3) of specific force and rate in each interval, without the extra variances."""
    acc, gyr = _mean_squares(recording.t, recording.acc, recording.gyr, sample, p.gravity)
    acc = p.acc_density**2 + p.acc_relative_density**2 * acc
    gyr = np.radians(p.gyr_density_deg_s) ** 2 + p.gyr_relative_density**2 * gyr
    return acc[:, None, None] * np.eye(3), gyr[:, None, None] * np.eye(3)


@njit(cache=True)
def _mean_squares(t: Floats, acc: Floats, gyr: Floats, sample: Ints, gravity: float) -> tuple[Floats, Floats]:
    """Mean squares (M-1,) of |f| - g and |w| over the time from each node to the next."""
    off_gravity, rate = np.zeros(len(sample) - 1), np.zeros(len(sample) - 1)
    for k in range(len(sample) - 1):
        for i in range(sample[k], sample[k + 1]):
            h = t[i + 1] - t[i]
            force = np.sqrt(acc[i, 0] ** 2 + acc[i, 1] ** 2 + acc[i, 2] ** 2)
            off_gravity[k] += (force - gravity) ** 2 * h
            rate[k] += (gyr[i, 0] ** 2 + gyr[i, 1] ** 2 + gyr[i, 2] ** 2) * h
        duration = t[sample[k + 1]] - t[sample[k]]
        off_gravity[k] /= duration
        rate[k] /= duration
    return off_gravity, rate
