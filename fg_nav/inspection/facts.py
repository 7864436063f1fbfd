"""The numbers of an inspection."""

from __future__ import annotations

from dataclasses import dataclass

from fg_nav.arrays import Floats
from fg_nav.samples.plausibility import GravityTransport


@dataclass(frozen=True)
class Stamps:
    """Time stamps.

    `rate_hz` is that of the sensor's clock, `jitter_s` the standard deviation of the stamps about it.
    `gaps` counts the places where samples were dropped; without one `longest_gap_s` is NaN and
    `longest_gap_row`, the row after the gap, None. `repeated`, `backward` and `missing` count samples.
    """

    rate_hz: float
    jitter_s: float
    gaps: int
    longest_gap_s: float
    longest_gap_row: int | None
    repeated: int
    backward: int
    missing: int


@dataclass(frozen=True)
class Range:
    """Saturation by axis: `share` (3,) of the samples and `level` (3,), NaN where there is none."""

    share: Floats
    level: Floats


@dataclass(frozen=True)
class Rest:
    """The sensor at rest.

    `duration_s` of rests (`fg_nav.detection.rest`) in all, the size of the mean acc, and the mean gyr (3,) in
    deg/s: its bias. Without rest `acc_m_s2` is that of the stillest moments, and the bias NaN.
    """

    duration_s: float
    acc_m_s2: float
    gyro_bias_deg_s: Floats


@dataclass(frozen=True)
class MagneticField:
    """Field strength: median and standard deviation in uT, and the samples a second."""

    strength_uT: float
    spread_uT: float
    rate_hz: float


@dataclass(frozen=True)
class StanceShare:
    """Stances found: their `count` and their `share` of the time; NaN and the `reason` if there are none."""

    count: int
    share: float
    reason: str = ""


@dataclass(frozen=True)
class Facts:
    """A recording in numbers.

    `refusal` is why it cannot be navigated with, None if it can; `unit_problems` name wrong units and axes;
    `field` is None without a magnetometer; `wearing` is "foot" or "pocket" where the turning is clearly that of one
    (`fg_nav.detection.mount`), else None; `notes` are the remarks of reader and admission.
    """

    name: str
    format: str
    samples: int
    duration_s: float
    stamps: Stamps
    acc_range: Range
    gyr_range: Range
    rest: Rest
    gravity: GravityTransport
    field: MagneticField | None
    stance: StanceShare
    wearing: str | None
    truth: str
    refusal: str | None
    unit_problems: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def is_usable(self) -> bool:
        """Whether estimators accept the recording."""
        return self.refusal is None


@dataclass(frozen=True)
class Inspection(Facts):
    """A recording in numbers, and the `verdict` in words: one sentence a finding, problems first."""

    verdict: tuple[str, ...]
