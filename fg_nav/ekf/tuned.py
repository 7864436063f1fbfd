"""The preset `tuned`: parameters chosen by `scripts/tune_filters.py` on simulated walks that are not reported.

What is not named here is as in the preset `physical`, the core of sensor and foot too. Detectors keep their shape: an
`allowance` multiplies what each of their channels expects and what matters to it.

One preset for a smooth field and a rough one. On the smooth alone Ma's physical gate is best, with 7 to 10 deg; on
the rough it passes nothing, and a filter that takes nearly every compass in with 20 to 30 deg halves the error of the
IEZ. So the tuned gates keep out the wildest changes only, and gain at most 10 % on no gate at all, which `qsf-stance`
is (errors over the IEZ's on 36 walks, seeds 1 to 6: 0.24 `ma2018`, 0.25 `iqsf` and `aiez`, 0.27 `qsf` and
`qsf-stance`). What lies within 2 % of the best was left as it was: 20 deg and a window of 2 would gain `qsf` 1.5 %.

AIEZ has no use for HDR there: of 16 deg or switched off, its course weighs alike, and with 4 deg the error is a fifth
more. It is left at 16.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from fg_nav.ekf.aiez import AGREEING, AiezParameters
from fg_nav.ekf.gated_compass import GatedCompassParameters
from fg_nav.magnetic.detectors import Detector
from fg_nav.magnetic.quasi_static import DETECTORS


def allowing(detector: Detector, allowance: float, window: int | None = None) -> Detector:
    """Return the detector that lets pass changes `allowance` times as large, over a `window` of its own."""
    channels = tuple(
        replace(channel, sigma=allowance * channel.sigma, matters=allowance * channel.matters)
        for channel in detector.channels
    )
    return replace(detector, channels=channels, window=detector.window if window is None else window)


TUNED: Mapping[str, GatedCompassParameters] = MappingProxyType(
    {
        "qsf": GatedCompassParameters(allowing(DETECTORS["qsf"], 8.0, window=1), compass_sigma_deg=30.0),
        "iqsf": GatedCompassParameters(allowing(DETECTORS["iqsf"], 16.0, window=5), compass_sigma_deg=30.0),
        "ma2018": GatedCompassParameters(allowing(DETECTORS["ma2018"], 16.0, window=2), compass_sigma_deg=30.0),
        "qsf-stance": GatedCompassParameters(DETECTORS["qsf-stance"], compass_sigma_deg=30.0),
        "aiez": AiezParameters(
            allowing(AGREEING, 1.4), compass_sigma_deg=20.0, start_sigma_deg=20.0, course_sigma_deg=16.0
        ),
    }
)
"""By method."""
