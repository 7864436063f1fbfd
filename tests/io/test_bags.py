"""ROS bags: read equal to the bit, whatever they are stored in, or refused with what to do."""

import builtins
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.errors import FgNavError, FormatError
from fg_nav.io import read, read_raw
from tests.io.foreign_sensors import write_bag
from tests.io.samples import tilting
from tests.io.test_broken_files import RELAXED, damage, is_a_line
from tests.real_data import DATA, needs_data

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")

RAW = tilting(np.random.default_rng(6), duration_s=1.0, rate_hz=100.0, still_s=0.3)


@pytest.mark.parametrize("name", ["walk.bag", "walk", "walk.mcap"])
@pytest.mark.parametrize("how", ["as it is", "the file alone", "zipped"])
def test_a_bag_is_read_to_the_bit(name: str, how: str, tmp_path: Path) -> None:
    path = tmp_path / name
    write_bag(RAW, path)
    files = [file for file in path.rglob("*") if file.suffix in (".mcap", ".db3")] or [path]
    if how == "the file alone":
        path = files[0].rename(tmp_path / "renamed.dat")
    elif how == "zipped":
        with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
            for file in sorted(path.rglob("*")) or [path]:
                archive.write(file, file.relative_to(tmp_path))
        path = tmp_path / "walk.zip"
    raw = read_raw(path)
    assert raw.provenance.format == "ros"
    assert raw.mag is not None
    np.testing.assert_allclose(raw.t, RAW.t, atol=1e-9)
    np.testing.assert_array_equal(raw.acc, RAW.acc)
    np.testing.assert_array_equal(raw.gyr, RAW.gyr)
    np.testing.assert_allclose(raw.mag[::4], RAW.mag[::4], rtol=1e-12)
    assert np.isnan(raw.mag[1::4]).all()
    assert raw.provenance.notes[:2] == ("the topic is /left/imu", "the magnetometer is /left/mag")


def test_one_of_several_topics_must_be_named(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    write_bag(RAW, path, ("/left/imu", "/right/imu"), normalized=True)
    with pytest.raises(
        FormatError, match=r"2 topics of sensor_msgs/Imu \(/left/imu, /right/imu\): .*--sensor /left/imu"
    ):
        read(path)
    raw = read_raw(path, sensor="right")
    assert raw.mag is None
    assert raw.provenance.notes[1].startswith("/left/mag is normalized (its strength is always 0.0001)")
    write_bag(RAW, path := tmp_path / "none.mcap", ())
    with pytest.raises(FormatError, match=r"no topic of sensor_msgs/Imu \(/left/mag\): record one"):
        read(path)


def test_without_the_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "walk.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    real = builtins.__import__

    def absent(name: str, *rest: object) -> object:
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(FormatError, match=r"which rosbags reads: pip install 'fg-nav\[ros\]'"):
        read(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("bags")
    for name in ("walk.bag", "walk.mcap", "walk"):
        write_bag(RAW, folder / name)
    return {file.suffix: file.read_bytes() for file in sorted(folder.rglob("walk*.*")) if file.is_file()}


@pytest.mark.parametrize("kind", [".bag", ".mcap", ".db3"])
@settings(RELAXED, max_examples=10)
@given(data=st.data())
def test_damaged(kind: str, data: st.DataObject, whole: dict[str, bytes], tmp_path: Path) -> None:
    path = tmp_path / f"walk{kind}"
    path.write_bytes(data.draw(damage(whole[kind])))
    try:
        read(path)
    except FgNavError as error:
        is_a_line(error)


@needs_data
def test_real_bags() -> None:
    one = read(DATA / "formats/rosbag1/sparkfun_razor.bag")
    assert one.period_s == pytest.approx(1 / 69, rel=1e-2)
    assert one.mag is None
    for place in ("razor_db3", "razor_mcap/razor_mcap.mcap"):
        np.testing.assert_array_equal(read(DATA / "formats/ros2-converted" / place).acc, one.acc)
