"""An inspection finds what was put into the recording, and says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection.stance import Stances
from fg_nav.errors import DetectionError
from fg_nav.inspection import Inspection, inspect
from fg_nav.io import read_raw
from fg_nav.recording import Provenance, RawRecording, Recording
from tests.io.samples import tilting
from tests.real_data import DATA, needs_data

RAW = tilting(np.random.default_rng(7), duration_s=12.0, still_s=4.0)
assert RAW.mag is not None
MAG = RAW.mag


def _detector(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    def detect_stances(recording: Recording) -> Stances:
        if share == 0:
            raise DetectionError("no stance was found: look at the statistic.")
        return Stances.from_mask(np.arange(len(recording)) % 100 < 100 * share)

    monkeypatch.setattr("fg_nav.inspection.detect_stances", detect_stances)


@pytest.fixture(autouse=True)
def _forty_per_cent_stance(monkeypatch: pytest.MonkeyPatch) -> None:
    _detector(monkeypatch, 0.4)


def _says(inspection: Inspection, part: str) -> bool:
    return any(part in sentence for sentence in inspection.verdict)


def test_a_good_recording() -> None:
    found = inspect(RAW)
    assert (found.is_usable, found.refusal, found.samples) == (True, None, 2400)
    assert (found.duration_s, found.stamps.rate_hz, found.stance.share) == pytest.approx((11.995, 200.0, 0.4))
    assert found.rest.acc_m_s2 == pytest.approx(9.80665, abs=0.01)
    assert found.field is not None
    assert found.field.strength_uT == pytest.approx(np.hypot(20, 43), abs=0.1)
    assert found.field.rate_hz == pytest.approx(200, rel=0.01)
    assert found.verdict == (
        "not to be used: the samples are smoothed, or no walk: no heel strike is in them above 8 Hz; low-pass at 20 Hz "
        "or more.",  # it is tilted by hand
        "The stamps are even, at 200.0 Hz.",
        "|acc| at rest is 9.81 m/s^2: gravity.",
        "Gravity turns as the gyroscope says: units and axes agree.",
        "The axes of gyroscope and accelerometer agree in 11 strides.",
        f"4 s of rest show the bias: {', '.join(f'{b:.2f}' for b in found.rest.gyro_bias_deg_s)} deg/s.",
        "The field is steady: 47 uT, 0 uT about it.",
        "24 stances make 40 % of the time.",
    )


def test_rest_and_bias() -> None:
    bias = np.array([0.3, -0.2, 0.5])
    found = inspect(replace(RAW, gyr=RAW.gyr + np.deg2rad(bias)))
    assert found.rest.duration_s == pytest.approx(4.0, abs=0.3)
    np.testing.assert_allclose(found.rest.gyro_bias_deg_s, bias, atol=0.02)
    large = inspect(replace(RAW, gyr=RAW.gyr + np.deg2rad(3 * bias)))
    assert large.verdict == replace(found, rest=large.rest).verdict  # it is known
    assert _says(inspect(replace(RAW, acc=RAW.acc * 1.05)), "|acc| at rest is 10.30 m/s^2, gravity 9.81: the acc")


def test_no_rest() -> None:
    found = inspect(_only(np.arange(len(RAW.t)) > 800))
    assert found.rest.duration_s == 0
    assert np.isnan(found.rest.gyro_bias_deg_s).all()
    assert _says(found, "There is no rest")
    assert _says(inspect(_only(np.arange(len(RAW.t)) > 450)), "only 1.")


def _only(kept: np.ndarray) -> RawRecording:
    return replace(RAW, t=RAW.t[kept], acc=RAW.acc[kept], gyr=RAW.gyr[kept], mag=MAG[kept], row=RAW.row[kept])


def test_stamps_that_are_uneven_repeated_backward_or_missing() -> None:
    index = np.arange(len(RAW.t))
    found = inspect(_only((index % 500 != 250) & ~((index > 1000) & (index < 1011))))
    assert found.is_usable
    assert (found.stamps.gaps, found.stamps.longest_gap_row) == (6, 1013)
    assert found.stamps.longest_gap_s == pytest.approx(0.055)
    assert _says(found, "Samples were dropped in 6 places; the longest gap is 55 ms before row 1013.")
    assert not _says(found, "The stamps are even")
    jitter = inspect(replace(RAW, t=RAW.t + 5e-4 * np.random.default_rng(1).uniform(size=len(RAW.t))))
    assert jitter.stamps.jitter_s == pytest.approx(5e-4 / np.sqrt(12), rel=0.05)
    assert _says(jitter, "The stamps jitter by 0.14 ms")
    t, acc = RAW.t.copy(), RAW.acc.copy()
    t[100:110], t[500], acc[700:760] = t[99], t[400], np.nan
    found = inspect(replace(RAW, t=t, acc=acc))
    assert (found.stamps.repeated, found.stamps.backward, found.stamps.missing) == (10, 1, 60)
    assert found.is_usable
    assert len(found.notes) == 4  # missing, late, repeated, bridged
    for part in ("range: 60 samples.", "Repeated: 10 stamps.", "backward: 1 stamp."):
        assert _says(found, part)


def test_wrong_units_are_all_named() -> None:
    found = inspect(replace(RAW, acc=RAW.acc / 9.80665, gyr=np.rad2deg(RAW.gyr), mag=MAG / 100))
    assert not found.is_usable
    assert "acc seems to be in g" in found.verdict[0]
    assert len(found.unit_problems) == 3


def test_saturation() -> None:
    rng = np.random.default_rng(2)
    swing = np.sin(2 * np.pi * 1.1 * RAW.t + 0.3 * np.sin(0.7 * RAW.t))
    gyr = RAW.gyr.copy()
    gyr[:, 1] = np.clip(14 * swing, -np.inf, 8.7) + 1e-3 * rng.normal(size=len(swing))
    found = inspect(replace(RAW, gyr=gyr))
    assert found.gyr_range.share[1] == pytest.approx(np.mean(14 * swing >= 8.7), abs=0.01)
    assert found.gyr_range.level[1] == pytest.approx(8.7, abs=0.05)
    assert np.isnan(found.gyr_range.level[[0, 2]]).all()
    assert _says(found, "gyr saturates on y")


def test_field() -> None:
    disturbed = inspect(replace(RAW, mag=MAG * np.linspace(0.5, 1.5, len(MAG))[:, None]))
    assert _says(disturbed, "The field is disturbed: 47 uT with a standard deviation of 14 uT.")
    sparse = inspect(replace(RAW, mag=np.where(np.arange(len(MAG))[:, None] % 4 == 0, MAG, np.nan)))
    assert sparse.field is not None
    assert sparse.field.rate_hz == pytest.approx(50, rel=0.01)
    assert inspect(replace(RAW, mag=None)).field is None
    assert _says(inspect(replace(RAW, mag=MAG * np.nan)), "The magnetometer has no sample.")


def test_stance_share(monkeypatch: pytest.MonkeyPatch) -> None:
    for share, part in (
        (0.0, "not to be used: it cannot be navigated with: no stance was found"),
        (0.05, "is this sensor on a foot?"),
        (0.95, "little walk in it"),
    ):
        _detector(monkeypatch, share)
        assert _says(inspect(RAW), part)


def test_hardly_any_sample() -> None:
    for n in (0, 1, 5, 30):
        found = inspect(replace(_only(np.arange(len(RAW.t)) < n), provenance=Provenance(None, "array")))
        assert (found.name, found.samples) == ("recording", n)
        assert (found.refusal is None) == (n >= 20)
        assert not found.is_usable  # 30 samples last 0.15 s
    nothing = np.full((100, 3), np.nan)
    found = inspect(RawRecording(nothing[:, 0], nothing, nothing, np.arange(100), nothing))
    assert (found.is_usable, found.stamps.missing) == (False, 100)


@needs_data
def test_real_recordings() -> None:
    assert DATA is not None
    xio = inspect(read_raw(DATA / "xio/short_walk.csv"))
    assert (xio.stamps.repeated, xio.stamps.gaps) == (205, 165)
    assert xio.stamps.rate_hz == pytest.approx(398.3, abs=0.1)
    gdin = inspect(read_raw(DATA / "gdin/own/SensorConnectData_40.csv"))
    assert gdin.stamps.rate_hz == pytest.approx(200, rel=1e-3)
    assert gdin.stamps.jitter_s == pytest.approx(2e-3, rel=0.1)
    assert gdin.truth == "89 footprints"
    broad = inspect(read_raw(DATA / "broad/01_undisturbed_slow_rotation_A.mat"))
    assert broad.field is not None
    assert broad.field.rate_hz == pytest.approx(202.4, abs=0.5)
    assert broad.rest.duration_s > 60
    assert broad.rest.acc_m_s2 == pytest.approx(9.81, abs=0.1)
    assert broad.is_usable
