"""The detectors of the papers, as physics has them and as printed.

What matters is our choice: over three strides 3 uT, along the field or across it. In Munich's field that is 3 uT of
strength, 4 deg of inclination or 8 deg of heading, and a compass that wavers more is worth little beside a gyroscope.
For AIEZ, a compass that is 10 deg off, or a strength that changes by 2.5 uT/s, 0.75 uT in a short stance.

Sigmas of the physical presets are an eighth of that: 1 deg of heading difference, 0.5 deg, 0.375 uT for one stance's
mean. On simulated walks in a homogeneous field noise is 0.1 deg, 0.05 deg and 0.04 uT with a calibrated sensor. With
one that is not it is 0.9 deg, 0.4 deg and 0.15 uT on the straights, and 8 deg, 2 deg and 0.9 uT as it turns, which no
detector can tell from a field that changes (MPU-9250 x 8, `scripts/calibration.py channels`). With a calibrated
sensor, therefore, fewer changes that matter pass than the false-alarm rate says, and next to all still fields. A
heading itself, of foot and compass alike, scatters by 2 deg from stride to stride, for a foot is not put down the
same way twice: iQSF is allowed 3 deg, and has to take 20 deg for the least turn that matters to tell them apart. The
compass of AIEZ is allowed 2.5 deg, beside the drift of the inertial heading.

As printed: Ma's sigmas, N = 3 and threshold 170. These sigmas are given in rad/s and used on radians a step, and 170
is no threshold of noise (it lets pass 28.9 deg a step in the heading difference alone). Zhang gives no value and
Afzal's and iQSF's are not in these papers: Ma's sigmas where they apply, 10 deg and 0.5 uT/s for AIEZ, and the 99 %
quantile that the authors' own assumption of independent changes asks for.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.stats import chi2

from fg_nav.magnetic.detectors import OFFSET, Channel, Detector, Form


def _make_channel(name: str, sigma: float, matters: float) -> Channel:
    return Channel(name, float(np.deg2rad(sigma)), float(np.deg2rad(matters)))


_STRENGTH = Channel("strength", sigma=0.375, matters=3.0)
_INCLINATION = _make_channel("inclination", sigma=0.5, matters=4.0)
_DIFFERENCE = _make_channel("heading difference", sigma=1.0, matters=8.0)
_STRENGTH_RATE = Channel("strength rate", sigma=0.5, matters=2.5)

MA_SIGMA_HEADING, MA_SIGMA_INCLINATION, MA_SIGMA_STRENGTH = 0.067, 0.054, 0.535
"""rad, rad, uT (5.35 mG): Ma 2018, from more than two hours of standing."""

_MA_STRENGTH = Channel("strength", MA_SIGMA_STRENGTH)
_MA_INCLINATION = Channel("inclination", MA_SIGMA_INCLINATION)


def _make_printed(
    name: str, form: Form, window: int, channels: tuple[Channel, ...], counts_drift: bool = True
) -> Detector:
    """As printed, with a threshold at the 99 % quantile of N C independent squares."""
    quantile = float(chi2.ppf(0.99, window * len(channels))) / window
    return Detector(name, channels, form, window, fixed_threshold=quantile, counts_drift=counts_drift)


_ALL = (
    Detector("qsf", (_STRENGTH,)),
    Detector(
        "iqsf",
        (
            _STRENGTH,
            _INCLINATION,
            _make_channel("magnetic heading", 3.0, 20.0),
            _make_channel("gyro heading", 3.0, 20.0),
        ),
    ),
    Detector("ma2018", (_DIFFERENCE, _INCLINATION, _STRENGTH)),
    Detector("aiez", (_make_channel(OFFSET, 2.5, 10.0), _STRENGTH_RATE), window=1),
    Detector("qsf-stance", (_STRENGTH_RATE,), window=1),
    _make_printed("qsf-printed", "sum of squares", 3, (_MA_STRENGTH,)),
    _make_printed(
        "iqsf-printed",
        "sum of squares",
        3,
        (
            _MA_STRENGTH,
            _MA_INCLINATION,
            Channel("magnetic heading", MA_SIGMA_HEADING),
            Channel("gyro heading", MA_SIGMA_HEADING),
        ),
    ),
    Detector(
        "ma2018-printed",
        (Channel("heading difference", MA_SIGMA_HEADING), _MA_INCLINATION, _MA_STRENGTH),
        "squared sums",
        window=3,
        fixed_threshold=170.0,
    ),
    _make_printed(
        "aiez-printed",
        "sum of squares",
        1,
        (Channel(OFFSET, float(np.deg2rad(10.0))), Channel("strength rate", 0.5)),
        counts_drift=False,
    ),
)

DETECTORS: Mapping[str, Detector] = MappingProxyType({detector.name: detector for detector in _ALL})
"""All detectors by name."""

DEFAULT = "ma2018"
"""It keeps to curved walks, where iQSF cannot, and needs no heading to begin with, as AIEZ does."""
