"""The script on the BROAD trials: that its errors are those of BROAD, and that it runs."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.recording import Recording
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

broad = load_script("broad_orientation")

RNG = np.random.default_rng(8)
TRUE = Rotation.random(400, random_state=8)
BIAS = np.radians([0.1, -0.2, 0.3])
TRIAL = SimpleNamespace(moving=np.arange(400) < 300, nav_R_true=TRUE, bias=BIAS)


def found(error, bias=BIAS):
    """Errors of the truth turned by `error` in nav."""
    return broad.errors_of(TRIAL, broad.Estimate(error * TRUE, np.tile(bias, (400, 1))))


def test_a_constant_heading_is_no_error():
    assert list(found(Rotation.from_rotvec([0, 0, 2.9])).values()) == pytest.approx([0, 0, 0, 0], abs=1e-6)


def test_a_tilt_is_inclination_whatever_way_it_leans():
    way = RNG.uniform(0, 2 * np.pi, 400)
    tilt = np.radians(3.0) * np.stack([np.cos(way), np.sin(way), 0 * way], axis=1)
    errors = found(Rotation.from_rotvec([0, 0, 1.0]) * Rotation.from_rotvec(tilt))
    assert errors["inclination"] == pytest.approx(3.0)
    assert errors["total"] == pytest.approx(3.0)
    assert errors["heading"] == pytest.approx(0.0, abs=1e-6)


def test_a_heading_that_swings_by_the_half_turn_is_heading_alone():
    swing = np.where(np.arange(400) % 2, 1, -1) * np.radians(5.0)
    errors = found(Rotation.from_rotvec(np.stack([0 * swing, 0 * swing, np.pi + swing], axis=1)))
    assert errors["heading"] == pytest.approx(5.0, rel=1e-3)
    assert errors["inclination"] == pytest.approx(0.0, abs=1e-6)


def test_what_happens_at_rest_does_not_count():
    late = np.where(np.arange(400) < 300, 0.0, 1.0)
    assert found(Rotation.from_rotvec(np.outer(late, [1, 0, 0])))["total"] == pytest.approx(0.0, abs=1e-6)


def test_a_bias_is_measured_by_its_length():
    assert found(Rotation.identity(), BIAS + np.radians([0.03, 0.0, 0.04]))["bias"] == pytest.approx(0.05)


@pytest.mark.parametrize("tapped", [0.0, 7.0])
def test_the_field_s_noise_is_that_of_its_means(tapped):
    rest, rate = 8000, 200.0
    mag = 40.0 + RNG.standard_normal((rest + 2000, 3))
    mag = (mag + np.roll(mag, 1, axis=0) + np.roll(mag, 2, axis=0)) / 3  # a filter: at low frequencies as it was
    mag[3000:3150] += tapped
    mag[1::2] = np.nan  # half of them are held: there are half as many, and so each one weighs more
    trial = SimpleNamespace(resting=np.arange(rest + 2000) < rest, recording=SimpleNamespace(mag=mag), rate=rate)
    assert broad.field_sigma_uT(trial) == pytest.approx(np.sqrt(0.5), rel=0.15)


def test_a_rate_of_the_period_before_a_stamp_is_put_at_the_stamp_before():
    gyr = RNG.standard_normal((50, 3))
    t = np.arange(50) / 100
    held = broad.hold_rates(Recording(t=t, acc=np.ones((50, 3)), gyr=gyr)).gyr
    assert (held[:-1] == gyr[1:]).all()


@needs_data
def test_a_trial_is_measured_beside_vqf(capsys, tmp_path):
    pytest.importorskip("vqf", reason="vqf is not installed: pip install 'fg-nav[dev]'")
    broad.main(["--data", str(DATA), "--trials", "36", "--json", str(tmp_path / "broad.json")])
    out = capsys.readouterr().out
    assert "36_disturbed_attached_magnet_5cm" in out
    for method in ("VQF offline", "VQF online", "batch", "causal", "paper's filter"):
        assert method in out
    # Its mean over all of BROAD is 2.9 deg (Laidig 2023): frames and quaternions are read as it means them.
    assert float(out.split("VQF offline")[1].split()[0]) < 3.0
    assert "nan" not in out
    assert (tmp_path / "broad.json").stat().st_size > 500
