"""Every format: of its sample no row is lost and none invented; a change of the file alters nothing, or is said.

What cannot be read is refused in one sentence: samples that were changed, and files by their content.
"""

from __future__ import annotations

import bz2
import codecs
import gzip
import json
import lzma
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import FORMATS, read_fixes, read_gnss, read_raw, read_truth, write_canonical
from fg_nav.io.content import read_content
from fg_nav.recording import Recording
from tests.io.every_format import SAMPLES, Change, files_of, write_changed
from tests.io.foreign_phones import expected_force
from tests.io.samples import RAW, write_zip
from tests.io.test_broken_files import is_a_line

ANY_TABLE = {"xio", "table", "tables"}  # Tried after the others: they are recognized by names that others have too.
LOST = {"xsens": [7], "dot": [0], "hyperimu": [0], "physics-toolbox": [399]}  # Rows the file itself lacks or zeroes.
FIELDS = {  # Samples of the magnetometer in the file, where it has not one in each row that is read.
    **dict.fromkeys(("estimated", "pyshoe", "gdlbio", "dot", "dot-increments", "x-IMU3"), 0),
    **{"openshoe": 376, "phyphox in one": 380, "walk.zip": 199},
    **dict.fromkeys(("metawear", "bag", "mcap", "db3"), 100),
    **{kind: 199 for kind in SAMPLES if kind.startswith(("phyphox,", "sensor-logger")) or kind == "phyphox"},
}


def test_every_format_has_a_sample() -> None:
    assert {sample.format for sample in SAMPLES.values()} | {"ros", "tables"} == set(FORMATS)  # ros is an extra


@pytest.mark.parametrize("kind", SAMPLES)
def test_no_row_is_lost_and_none_invented(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    content = read_content(path)
    found = [name for name, one in FORMATS.items() if content.kind in one.kinds and one.recognizes(content)]
    assert found[0] == sample.format
    assert set(found) <= {sample.format, *ANY_TABLE}
    raw = read_raw(path, sensor=sample.sensor)
    assert (raw.provenance.format, raw.provenance.path) == (sample.format, path)
    # samples
    recording = Recording.from_raw(raw)
    # they begin where the first rates are most alike
    apart = [np.abs(RAW.gyr[k : k + 5] - recording.gyr[:5]).sum() for k in range(30)]
    k = int(np.argmin(apart)) + np.rint((recording.t - recording.t[0]) * 100).astype(int)
    lost = [0, 399] if sample.late else LOST.get(kind, [])
    assert k.tolist() == np.delete(np.arange(len(RAW.t)), lost).tolist()
    np.testing.assert_allclose(recording.t - recording.t[0], RAW.t[k] - RAW.t[k[0]], atol=2e-3)
    np.testing.assert_allclose(recording.gyr, RAW.gyr[k], atol=sample.digits)
    force = expected_force(RAW, RAW.t[k]) if sample.late else RAW.acc[k]
    np.testing.assert_allclose(recording.acc, force, atol=max(sample.digits, 1e-6))
    field = np.full_like(RAW.gyr[k], np.nan) if recording.mag is None else recording.mag
    sampled = np.isfinite(field).all(axis=1)
    assert sampled.sum() == FIELDS.get(kind, len(k))
    np.testing.assert_allclose(field[sampled], RAW.mag[k][sampled], atol=max(1e-4, 100 * sample.digits))
    # lines of the file
    assert raw.row.shape == raw.t.shape
    assert (np.diff(raw.row) > 0).all()
    assert 1 <= raw.row[0] <= 12
    assert raw.row[-1] <= max(*(place.read_bytes().count(b"\n") for place in files_of(path)), len(RAW.t) + 1)
    # the same in an archive
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        for place in files_of(path):
            archive.write(place, place.relative_to(path.parent))
    if kind not in ("walk.npz", "walk.zip"):  # which are archives
        np.testing.assert_array_equal(read_raw(tmp_path / "packed.zip", sensor=sample.sensor).acc, raw.acc)


NOTES = [
    ("xsens", "time is the packet counter at 100 Hz"),
    ("xsens", "the packet counter began again at its end 1 time: set on"),
    ("xsens", "the magnetometer is in units of the local field (median 0.99): 1 is taken for 48 uT"),
    ("dot", "SampleTimeFine began again at its end 1 time: set on"),
    ("dot", "left out 1 missing sample, the first in row 9"),
    ("dot-sdk-rad", "SampleTimeFine is in 0.1 ms, as its steps of 100 show"),
    ("dot-sdk-rad", "the gyroscope is in rad/s: its size shows it, or gravity, which turns as it says"),
    ("shimmer", "of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame"),
    ("shimmer-wide", "the accelerometer is that of wide range (WR): the file has no other"),
    ("apdm", "the sensor is 'Left Foot'"),
    ("phyphox", "recorded by phyphox 1.1.16 on P1"),
    ("phyphox", "accelerometer 100.0 Hz, gyroscope 100.0 Hz, magnetometer 50.0 Hz, begun 2 ms apart: put on the "
     "gyroscope's clock, the accelerometer by straight lines"),
    ("sensor-logger, iPhone", "specific force is -(Accelerometer + Gravity), as an iPhone has the sign turned"),
    ("sensor-logger, iPhone", "time 0 is 2022-09-16 11:15:47.248 UTC"),
    ("sensor-logger, Android", "specific force is TotalAcceleration"),
    ("sensor-logger, standardised", "specific force is (Accelerometer + Gravity)"),
    ("sensor-logger, uncalibrated", "specific force is -9.80665 * AccelerometerUncalibrated, as an iPhone has the "
     "sign turned"),
    ("sensor-logger, uncalibrated", "the gyroscope is uncalibrated: its bias is still in it"),
    *((kind, "the topic is /left/imu") for kind in ("bag", "mcap", "db3")),
    *((kind, "the magnetometer is /left/mag") for kind in ("bag", "mcap", "db3")),
    ("x-IMU3", "Magnetometer.csv is in arbitrary units and was left out"),
]  # fmt: skip


@pytest.mark.parametrize("kind", [kind for kind in dict(NOTES) if kind in SAMPLES])
def test_what_was_taken_for_what_is_said(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    notes = Recording.from_raw(read_raw(sample.write(RAW, tmp_path), sensor=sample.sensor)).provenance.notes
    for words in (words for own, words in NOTES if own == kind):
        assert words in notes


SAME: list[tuple[str, list[Change]]] = [
    ("canonical", [("", r"(?m)^([^,]+,[^,]+),(.*)$", r"\2,\1")]),
    ("canonical", [("", r"(?m)^(.*)$(?!\Z)", r"\1,x"), ("", r",x\n", ",note\n")]),
    ("sensorconnect", [("", r"\A", "SESSION_INFO\nname,rate\n3DM-GX5,200\n\nDATA_START\n")]),
    ("sensorconnect", [("", r"(?m)^0\.(\d\d),(.*)$", r"0.\1,\2" + "\n" + r"0.\g<1>1,,,,,,,,,")]),
    ("xio", [("", r"Gyroscope Y \(deg/s\)", "Gyroscope Y")]),
    ("xio", [("", r"Time \(s\)", "Time")]),
    ("xsens", [("", "\t", ";")]),
    ("xsens", [("", "\t", ",")]),
    ("xsens", [("", "\t", " ")]),
    ("dot", [("", r", ?", ";")]),
    ("dot", [("", r"(?s)\A.*?(?=PacketCounter)", "")]),
    ("shimmer", [("", r"\.", ",")]),
    ("shimmer", [("", r"\.", ","), ("", ";", "\t")]),
    ("phyphox", [("Linear", "", None)]),
    ("sensor-logger, iPhone", [("Gyroscope", r"\Z", "16633269472")]),
]


@pytest.mark.parametrize(("kind", "changes"), SAME)
def test_changes_that_alter_nothing(kind: str, changes: list[Change], tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    whole = read_raw(SAMPLES[kind].write(RAW, tmp_path / "whole"))
    changed = read_raw(write_changed(kind, RAW, tmp_path, *changes))
    assert changed.provenance.format == whole.provenance.format
    for name in ("t", "acc", "gyr", "mag"):
        if getattr(whole, name) is not None:
            np.testing.assert_allclose(getattr(changed, name), getattr(whole, name), atol=1e-9)


WITHOUT_GRAVITY = "no accelerometer.*record the accelerometer, with gravity in it"
CHANGED: list[tuple[str, str, list[Change]]] = [
    *((kind, "has a header but no samples", [("", r"\n(?s:.*)", end)])
      for kind, end in (("canonical", ""), ("sensorconnect", "\n\n\n"), ("estimated", "\n"), ("xio", "\r\n"))),
    ("canonical", "no column 'acc_x_m_s2'", [("", "acc_x_m_s2", "temperature")]),
    ("canonical", r"walk\.dat, line 31, column 'acc_y_m_s2': 'oops' is not a number",
     [("", r"\A((?:.*\n){30}(?:[^,]*,){2})[^,]*", r"\1oops")]),
    ("sensorconnect", "has no column 'scaledAccelX'", [("", "scaledAccel", "estLinearAccel")]),
    ("sensorconnect", "2 columns 'scaledAccelX': keep one", [("", "1.2:scaledGyro", "3.4:scaledAccel")]),
    ("estimated", "no column 'estAngularRateZ'", [("", "estAngularRateZ(?!:)", "temperature")]),
    ("xio", "more than one acceleration", [("", r"Accelerometer X", "Accelerometer Y")]),
    ("xio", "not all three axes of angular rate, only 'Gyroscope X", [("", "Gyroscope Z", "Gyroscope")]),
    ("xio", "has no stamps: give its rate", [("", r"Time \(s\)", "Temperature (C)")]),
    ("xio", r"not a regular table.*line 11", [("", r"\A((?:.*\n){10}.*)", r"\1,1,2,3")]),
    ("openshoe", "16 columns, not 17", [("", r"0xcb +\S+", "0xcb")]),
    ("xsens", r"neither time nor rate.*--rate 100", [("", r"//  Update Rate.*\n", "")]),
    ("xsens", "no accelerometer and no gyroscope .FreeAcc is without gravity", [("", "(Acc|Gyr)_", r"Free\1_")]),
    ("dot", "no accelerometer and no gyroscope .FreeAcc is.*'Custom Mode 5'", [("", "(Acc|Gyr)_", r"Free\1_")]),
    ("movesense", "no gyroscope, only accelerometer and magnetometer", [("", "ArrayGyro", "ArrayTemp")]),
    ("movesense", "no whole JSON", [("", "(?s).{5000}$", "")]),
    *(("movesense", "has no stamp", [("", r'"Timestamp": \d+', f'"Timestamp": {stamp}')])
      for stamp in ("true", '"500"', "NaN", "1e999")),
    ("metawear", "has no gyroscope, only accelerometer", [("Gyroscope", "", None), ("Magn", "", None)]),
    ("phyphox", r"lasts 4.0 s, but meta/time.csv says 1.5 s: give the files of one",
     [("time.csv", r'"PAUSE",[^,]*', '"PAUSE",1.5')]),
    ("phyphox", WITHOUT_GRAVITY, [("Linear", "", None), ("Accelerometer", '"Acc', '"Linear Acc')]),
    ("phyphox", "has no gyroscope, only accelerometer and magnetometer", [("Gyroscope", r"\n(?s:.*)", "\n")]),
    ("sensor-logger, iPhone", WITHOUT_GRAVITY, [("Gravity", "", None)]),
    ("sensor-logger, iPhone", r"of an iPhone or of an Android phone.* Metadata.csv", [("Metadata", "", None)]),
    ("sensor-logger, iPhone", "has no gyroscope, only acc", [("Gyroscope", r"\n(?s:.*)", "")]),
    ("sensorlog", WITHOUT_GRAVITY, [("", "accelerometerAcceleration", "motionUserAcceleration")]),
    ("physics-toolbox", WITHOUT_GRAVITY, [("", "gF", "lost")]),
    ("androsensor", WITHOUT_GRAVITY, [("", "ACCELEROMETER", "OTHER")]),
    ("hyperimu", WITHOUT_GRAVITY, [("", "MPL_Accelerometer", "MPL_Linear_Acceleration")]),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "words", "changes"), CHANGED)
def test_what_lacks_something_is_refused(kind: str, words: str, changes: list[Change], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=words) as caught:
        Recording.from_raw(read_raw(write_changed(kind, RAW, tmp_path, *changes)))
    is_a_line(caught.value)


@pytest.mark.parametrize("kind", ["androsensor", "gnss-logger", "hyperimu"])
def test_slow_apps_are_refused(kind: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"has 2 samples a second, too few to follow a walk"):
        read_raw(SAMPLES[kind].write(replace(RAW, t=RAW.t * 50.0), tmp_path))


@pytest.mark.parametrize("kind", SAMPLES)
def test_one_that_is_cut_within_its_beginning_is_refused(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    for place in files_of(path):
        place.write_bytes(place.read_bytes()[:60])
    with pytest.raises(FormatError) as caught:
        read_raw(path, sample.format, sensor=sample.sensor)
    is_a_line(caught.value)
    assert ": " in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("xio", {"format": "canonical"}, "no column 'time_s'"),
        ("xio", {"format": "pyshoe"}, "not a MATLAB file"),
        ("xio", {"format": "gaitup"}, r"no format 'gaitup'.*canonical, sensorconnect"),
        ("pyshoe", {"format": "xio"}, "not a text file"),
        ("xio", {"rate_hz": 100.0}, "of format 'xio', which has no rate to choose: leave --rate out"),
        ("xio", {"sensor": "left"}, "no sensor to choose"),
        ("xio", {"format": "xio", "columns": "acc=1:2:3,gyr=4:5:6"}, "--columns maps a table"),
        ("apdm", {}, r"2 sensors \(Lumbar, Left Foot\): name one, such as `--sensor 'Left Foot'`"),
        ("apdm", {"sensor": "right"}, "no one 'right' among its sensors: choose one of Lumbar, Left Foot"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    kind: str, options: Mapping[str, object], words: str, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=words) as caught:
        read_raw(SAMPLES[kind].write(RAW, tmp_path), **options)
    is_a_line(caught.value)


# by their content


def _with_barometer(path: Path) -> object:
    write_canonical(RAW, path.parent / "recording.csv")
    return read_raw(path.parent / "recording.csv", barometer=path)


SEVENS = b"1,2,3,4,5,6,7\n" * 9
UPRIGHT = "0 0 0 0 0 0 0 1\n"
FIXES = "time_s,x_m,y_m,z_m,sigma_m\n"
PACKED = "packed in a way that is not read here: unpack it"
CONTENT: list[tuple[Callable[[Path], object], str | bytes, str]] = [
    *((read_raw, content, words) for content, words in {
        b"": "is empty",
        b"  \n \n": "is empty",
        b"hello,world\n1,2\n": r"none of the \d+ formats.*fg-nav inspect",
        bytes(range(256)) * 40: r"none of the \d+ formats",
        b"MATLAB 5.0 MAT-file" + bytes(2000): r"damaged MATLAB file|none of the \d+ formats",
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + b" " * 86 + b"\x00\x02IM" + bytes(500): "7.3",
        b"\x89HDF\r\n\x1a\n\0\0": "HDF5 file",
        json.dumps([{"t": k, "acc": [0, [1], 9.8]} for k in range(3)]).encode(): "no whole JSON of samples",
        b"stride,x_m,y_m\n0,0,0\n1,1,1\n": "is no recording but footprints: .*--truth",
        f"{FIXES}1,2,3,4,1\n".encode(): "is no recording but known positions.*--fixes",
        b'{\n "format": "fg-nav calibration",\n "version": 1\n}': "is no recording but a calibration.*--calibration",
        b"# t x y z qx qy qz qw\n" + b"".join(b"%d.5 0 0 0 0 0 0.6 0.8\n" % k for k in range(9)):
            "is no recording but a true path.*--truth",
        b"1 2 3 4 1e300 0 0 1\n" * 9: "8 columns and no header",
        b"a,b,c,d,e,f,g\n" + SEVENS: "no column for acceleration among 'a', 'b'.*\"acc=NAME",
        b"t,ax,ay,az,p,q,r\n" + SEVENS: "no column for angular rate among .*gyr=NAME",
        b"dear reader,\nno numbers here\n": r"none of the \d+ formats.*text without a table.*fg-nav inspect",
    }.items()),
    *((read_truth, content, words) for content, words in {
        "": "is empty",
        "hello\n": "no truth read here: give TUM lines",
        UPRIGHT + "1 0 0 0 0 0 0 2\n": "line 2: stamps must rise and quaternions have length 1",
        UPRIGHT * 2: "line 2: stamps must rise",
        UPRIGHT + "1 0 x 0 0 0 0 1\n": "line 2, column 'y': 'x' is not a number",
        UPRIGHT + "1 0 0 0 0 0\n": "line 2",
        "stride,x_m\n0,0\n": "no column 'y_m'",
        "stride,x_m,y_m\n": "no samples",
        "stride,x_m,y_m\n0,0,0\n1.5,0,0\n": "whole and rising",
        "stride,x_m,y_m\n0,0,0\n2,0,0\n1,0,0\n": "whole and rising",
        "stride,x_m,y_m\n0,0,0\n1,,0\n": "not finite",
    }.items()),
    *((read_fixes, content, words) for content, words in {
        "time_s,x_m,y_m,sigma_m\n1,2,3,4\n": "no column 'z_m'",
        FIXES: "no samples",
        f"{FIXES}1,2,3,4,0.1\n2,three,3,,1\n": "line 3, column 'x_m'",
        f"{FIXES}1,2,3,4,0.1\n2,,3,,1\n": "line 3 lacks a number",
        f"{FIXES}1,2,3,inf,0.1\n": "line 2 lacks a number",
        f"{FIXES}1,2,3,,\n": "line 2 lacks a number",
        f"{FIXES}1,2,3,,1\n\n1,2,3,,0\n": "line 4 has no sigma above zero",
    }.items()),
    *((read_gnss, content, words) for content, words in {
        "time_s,latitude,longitude\n1,48,11\n": "no column of accuracy",
        "t,x_m,y_m\n1,2,3\n": "no column of time, latitude, longitude, accuracy",
        "t,lat,lon,accuracy\n1,48,11,0\n": "no fix with an accuracy above zero",
    }.items()),
    *((_with_barometer, content, words) for content, words in {
        "time_s,x\n0,1\n": "names no pressure",
        "x,pressure_pa\n0,101325\n": "has no time",
        "time_s,pressure_pa\n0,-5\n1,-5\n": "no pressure of air",
        "time_s,pressure_pa\n9000,101325\n9001,101325\n": "on its clock",
    }.items()),
]  # fmt: skip


@pytest.mark.parametrize(("reader", "content", "words"), CONTENT)
def test_what_a_file_does_not_hold_is_said(
    reader: Callable[[Path], object], content: str | bytes, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "walk.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FormatError, match=rf"(?s)\Awalk\.csv.*{words}.*[.?]\Z") as caught:
        reader(path)
    is_a_line(caught.value)


def test_damaged_and_locked_archives(tmp_path: Path) -> None:
    write_canonical(RAW, tmp_path / "walk.csv")
    text = (tmp_path / "walk.csv").read_bytes()[:9000]
    whole = write_zip(tmp_path / "walk.zip", {"walk.csv": text}, packed=False).read_bytes()
    cannot, other = "walk.zip cannot be opened, or is damaged", "text that is not in UTF-8, UTF-16 with a mark"
    for message, data in (
        (f"{cannot} .*not a zip file", whole[:-30]),
        ("walk.zip/walk.csv cannot be opened, or is damaged .*CRC", whole.replace(b"acc_y", b"acc_q")),
        ("is encrypted, password required", whole.replace(b"\x14\x03\x14\x00\x00", b"\x14\x03\x14\x00\x01")),
        (f"{cannot} .*ended before", gzip.compress(text)[:-100]),
        (cannot, gzip.compress(text)[:3] + b"\xff" * 3000),
        (other, text.decode().encode("utf-16-le")),
        (other, codecs.BOM_UTF32_LE + text.decode().encode("utf-32-le")),
        (PACKED, bz2.compress(text)),
        (PACKED, lzma.compress(text)),
    ):
        (tmp_path / "walk.zip").write_bytes(data)
        with pytest.raises(FormatError, match=message):
            read_raw(tmp_path / "walk.zip")


def test_what_is_not_there_and_what_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "walk.csv").write_text("t")
    for reader, place, words in (
        (read_raw, tmp_path / "empty", "holds no file that is not empty"),
        (read_gnss, tmp_path, r"no Location\.csv"),
        (read_raw, tmp_path / "nowhere.csv", r"nowhere\.csv does not exist"),
        (read_raw, "a\0b", "cannot be opened"),
    ):
        with pytest.raises(FormatError, match=words):
            reader(place)

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)  # the tests may run as root, who may read all
    with pytest.raises(FormatError, match=r"cannot be opened.*Permission denied.*check its permissions"):
        read_raw(tmp_path / "walk.csv")
