"""What cannot be read is refused in one sentence: samples that were changed, and files by their content."""

from __future__ import annotations

import bz2
import codecs
import gzip
import json
import lzma
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.errors import FormatError
from fg_nav.io import read_fixes, read_gnss, read_raw, read_truth, write_canonical
from fg_nav.recording import Recording
from tests.io.every_format import SAMPLES, Change, files_of, write_changed
from tests.io.samples import RAW, write_zip
from tests.io.test_broken_files import is_a_line

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
