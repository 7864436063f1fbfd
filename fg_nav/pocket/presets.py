"""The pocket's filter by name.

====================== ============================================================================================
munoz-diaz2017         the paper's filter with its misprints corrected; the default
munoz-diaz2017-printed the equations as printed, `fg_nav.pocket.printed`, and gravity by samples, with the noise of an
                       accelerometer of 0.003 m/s^2/sqrt(Hz): it does not work, and shows why
====================== ============================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from fg_nav.errors import EstimationError
from fg_nav.pocket.parameters import PocketParameters

PRESETS: Mapping[str, PocketParameters] = MappingProxyType(
    {
        "munoz-diaz2017": PocketParameters(),
        "munoz-diaz2017-printed": PocketParameters(
            bias_returns_to_zero=True,
            gravity_window_s=0.0,
            acc_sigma_m_s2=0.03,
            difference_as_printed=True,
            arctangent_as_printed=True,
            euler_state=True,
        ),
    }
)
"""By name, the default first."""


def pocket_parameters(name: str) -> PocketParameters:
    """Parameters of a preset.

    Raises
    ------
    EstimationError
        If there is none of that name.
    """
    if name not in PRESETS:
        raise EstimationError(f"there is no preset '{name}' for the pocket: choose from {', '.join(PRESETS)}.")
    return PRESETS[name]
