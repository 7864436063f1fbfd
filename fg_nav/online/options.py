"""What a user can choose of a walk in progress."""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.fix_check import check_fixes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.truth import Fix


@dataclass(frozen=True)
class OnlineOptions:
    """What a user can choose.

    Attributes
    ----------
    heading_rad : of the body's x axis at the first stance, clockwise from north; None where it is not known: then
        zero, or with the field so that the mean field points north (found at footfall 4 and better each time the walk
        is solved again).
    use_field : whether the magnetometer is used. Samples without one are then allowed.
    lag_s : how far back the past is still corrected, s; None for the whole walk (full mode).
    parameters : of the smoother.
    axes_given : whether the magnetometer is used whatever its axes look like.
    fixes : positions that are known from elsewhere, at times of the walk to come.
    calibration : by which the samples of the magnetometer are corrected already; None for that of the walk itself.

    Raises `EstimationError` for fixes that cannot be.
    """

    heading_rad: float | None = 0.0
    use_field: bool = True
    lag_s: float | None = None
    parameters: SmootherParameters = field(default_factory=SmootherParameters)
    axes_given: bool = False
    fixes: tuple[Fix, ...] = ()
    calibration: MagnetometerCalibration | None = None

    def __post_init__(self) -> None:
        check_fixes(self.fixes)
