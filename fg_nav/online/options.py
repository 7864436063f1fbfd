"""What a user can choose of a walk in progress."""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.fix_check import check_fixes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.truth import Fix


@dataclass(frozen=True)
class OnlineOptions:
    """What a user can choose; raises `EstimationError` for fixes that cannot be."""

    # Of the body's x axis at the first stance, clockwise from north. None where it is not known: then zero, or with the
    # field so that the mean field points north (from footfall 4 on, refined each time the walk is solved again).
    heading_rad: float | None = 0.0
    use_field: bool = True  # Whether the magnetometer is used; samples without one are then allowed.
    lag_s: float | None = None  # How far back the past is corrected; None for the whole walk.
    parameters: SmootherParameters = field(default_factory=SmootherParameters)
    axes_given: bool = False  # Whether the magnetometer is used whatever its axes look like.
    fixes: tuple[Fix, ...] = ()  # Positions known from elsewhere, at times of the walk to come.
    calibration: MagnetometerCalibration | None = None  # Already applied; None to estimate it on the walk.

    def __post_init__(self) -> None:
        check_fixes(self.fixes)
