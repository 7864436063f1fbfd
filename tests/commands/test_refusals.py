"""What cannot be is refused in one line, nothing is written, and what the line proposes is accepted."""

import re
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fg_nav.calibration.of_recording import METHODS
from fg_nav.commands.requests import REQUESTS
from fg_nav.commands.shared import APPLIES
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.field_survey import SAMPLEWISE
from fg_nav.magnetic.detectors import DEFAULT
from tests.command_line import FgNav, Ran, names
from tests.commands.recordings import FOLDER, recorded, recording, truth_of
from tests.io.samples import axes, write_columns
from tests.proposals import check_proposals
from tests.real_data import CASES

NO_RECORDINGS = {name: name for name in ("missing.csv", "letter.txt", "raw.bin", "empty.csv")}
FIXES = "time_s,x_m,y_m,z_m,sigma_m\n"
TEXTS = {
    "bad.fixes": FIXES + "10,1,2,,0\n",
    "late.fixes": FIXES + "1000,1,2,,1\n",
    "good.fixes": FIXES + "10,1,2,,1\n",
    "empty.csv": "",
    "letter.txt": "Dear sir,\nno data.\n",
    "cut.json": "{",
    "foreign.json": "{}",
}
PLAIN = ["t", *axes("a{}", "g{}", letters="xyz")]


@cache
def tables() -> dict[str, tuple[list[str], list[object]]]:
    """Names and columns of tables that leave something open."""
    walk = recording("part").slice(1500, 4000)
    t, acc, gyr = walk.t - walk.t[0], walk.acc, walk.gyr
    g, deg, still = acc / GRAVITY_M_S2, np.degrees(gyr), 0.02 * np.random.default_rng(1).normal(size=acc.shape)
    return {
        "counts": (PLAIN, [t, np.round(g * 2048), np.round(deg * 16.4)]),
        "still": (PLAIN, [t, still + np.array([0.0, 0.0, 9.81]), still]),
        "swapped": (PLAIN, [t, gyr, acc]),
        "steps": (PLAIN, [t * 4e4, acc, gyr]),
        "fast": (PLAIN, [t, acc, 1e3 * deg]),
        "twice": (["t", *axes("a{}", "acc_{}", "g{}", letters="xyz")], [t, g, g, deg]),
        "feet": ([*PLAIN, *(f"right_{name}" for name in PLAIN[1:])], [t, g, deg, g, deg]),
        "clocks": (["time", *PLAIN], [t, t, g, deg]),
        "linear": (["t", *axes("lin_acc_{}", "g{}", letters="xyz")], [t, acc, gyr]),
        "two": (PLAIN[:6], [t, acc, gyr[:, :2]]),
        "pqr": ([*PLAIN[:4], "p", "q", "r"], [t, acc, gyr]),
        "bare file": ([*map(str, range(1, 8))], [t, acc, gyr]),
        "odd": ([f"c{k}" for k in range(7)], [t, acc, gyr]),
        "none": (PLAIN[1:], [acc, gyr]),
        "fives": (PLAIN, [t, acc / 2.0, gyr]),
        "foot print": (["stride", "x_m", "y_m"], [np.arange(4)] * 3),
        "dot": (["PacketCounter", "SampleTimeFine", *axes("Acc_{}", "Gyr_{}")],
                [np.arange(len(t)), np.round(t * 1e4), acc, gyr]),
        "acc": (["t", "x", "y", "z"], [t, acc]),
        "gyro": (["t", "x", "y", "z"], [t, gyr]),
    }  # fmt: skip


@cache
def table(name: str) -> Path:
    """Its file, in a folder of its own."""
    path = Path(FOLDER.name) / "tables" / name / f"{name}.csv"
    path.parent.mkdir(parents=True)
    write_columns(path, *tables()[name])
    if name == "bare file":
        path.write_text(path.read_text().split("\n", 1)[1])
    return path


def find(word: str) -> object:
    """What a word of a row stands for: RECORDING, %table, truth, or itself."""
    if word.isupper() and word.isalpha():
        return recorded(word.lower())
    if word.startswith("%"):
        return table(word[1:].replace("_", " "))
    if word in ("truth.tum", "late.tum"):
        return truth_of("walk", 1000.0 * (word == "late.tum"))
    return word


def test_what_applies_somewhere_is_an_option() -> None:
    assert APPLIES.keys() <= {item.name for request in REQUESTS for item in fields(request)}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        # options that misfit
        ("run a.csv --sides left,right", "--sides is for --mount feet: add that, or leave --sides out."),
        ("run a.csv b.csv --mount feet --places p", "--places is for --mount foot: leave --places out."),
        ("run a.csv --no-mag --gate qsf", "--gate is for the magnetic field: leave --gate out with --no-mag."),
        ("run a.csv b.csv --truth t.tum", "--truth is of one recording: give the 2 one by one."),
        ("run a.csv --method iez --polish", "iez makes no use of --polish: leave --polish out, or choose online."),
        ("compare a.csv --methods qsf,ma2018 --gate qsf", "qsf makes no use of --gate: leave --gate out, or choose"),
        ("inspect a.csv b.csv --barometer p.csv", "--barometer is of one recording: give the 2 one by one."),
        ("stream a.csv --mount pocket --lag 60", "--lag is for --mount foot: leave --lag out."),
        ("stream a.csv --mount pocket --gate aiez", "--gate is for --mount foot or feet: leave --gate out."),
        ("stream a.csv --mount pocket --fixes good.fixes", "--fixes is for --mount foot"),
        ("run a.csv --mount pocket --fixes good.fixes", "--fixes is for --mount foot: give | --gnss"),
        ("stream a.csv --step-constant 0.8", "--step-constant is for --mount pocket: add that, or leave"),
        ("stream PART --mount pocket --step-constant 5", "no person's"),
        ("stream a.csv --lag 60 --polish", "--polish"),
        ("stream a.csv --silence 0", "--silence"),
        ("stream a.csv --heading nan", "nan"),
        ("stream a.csv --resume", "--record"),
        ("stream a.csv --columns t,ax", "--columns lacks"),
        ("stream no-such-file", "no-such-file"),
        ("stream PART --fixes no.csv", "no.csv"),
        ("stream ftp://here:1", "ftp://here:1"),
        ("stream tcp://127.0.0.1", "tcp://127.0.0.1"),
        ("stream tcp://no.such.host.invalid:1", "no.such.host.invalid"),
        ("stream udp://:99999", "udp://:99999"),
        ("stream udp://:1 --speed 2", "--speed"),
        ("stream a.csv --mount feet", "takes two sources"),
        ("stream a.csv a.csv --mount feet", "is named twice"),
        ("stream a.csv b.csv --mount feet --lag 60", "--lag is for --mount foot"),
        ("stream a.csv b.csv --mount feet --record r.csv", "--record is for --mount foot"),
        ("stream a.csv b.csv --mount feet --calibration one.json", "--calibration A,B"),
        ("run a.csv --clock-offset 1", "is for --mount feet: add that"),
        ("run a.csv b.csv --mount feet --fixes f.csv", "--fixes"),
        ("run a.csv b.csv --mount feet --truth t.tum", "A,B"),
        ("run a.csv b.csv --mount feet --method iez", "one of smoother, inertial"),
        ("run a.csv --places p --no-mag", "--no-mag"),
        ("run a.csv b.csv --save-places two", "--save-places is of one recording"),
        ("run a.csv --mag-axes=y,x,z --no-mag", "--mag-axes"),
        ("stream a.csv b.csv", "a second source is for --mount feet: add that, or leave a second source out."),
        # choices
        ("run PART --method magic", "no method 'magic'"),
        ("compare PART --methods iez,,smoother", "no method ''"),
        ("run PART --format magic", "magic"),
        ("run PART --truth nowhere.tum", "nowhere.tum"),
        ("run PART --method iez --truth late.tum", "share no time"),
        ("run PART --out taken", "taken is a file"),
        ("run PART --force", "--out"),
        ("run .", "fg-nav: "),
        ("run truth.tum", "is no recording but a true path | --truth"),
        ("run PART --method iez --preset magic", "no preset 'magic'"),
        ("run PART --method aiez --no-mag", "aiez needs a magnetometer"),
        ("run PART --gate magic", "no gate 'magic'"),
        ("run PART --mag-axes=x,y", "'x,y' names no axes"),
        ("run PART --columns acc=1:2", "three columns"),
        ("run PART BARE --truth truth.tum", "one by one"),
        # settings
        ("run PART --set smoother.acc_densty=1", "the nearest is 'smoother.acc_density'"),
        ("run PART --set acc_density=1", "the nearest is 'smoother.acc_density'"),
        ("run PART --set iez.acc_density=1", "no parameter 'iez.acc_density'"),
        ("run PART --set smoother.magnetic=1", "has parts: choose one of smoother.magnetic.compass"),
        ("run PART --set smoother.acc_density", "write --set smoother.acc_density=VALUE"),
        ("run PART --set smoother.acc_density=-1", "cannot be -1: give a number that is not below zero"),
        ("run PART --set smoother.acc_density=" + "[" * 5000, "cannot be '[[["),  # brackets without end are a word
        ("run PART --set smoother.acc_density=null", "cannot be None: give a number"),
        ("run PART --set smoother.magnetic.rounds=1.5", "give a whole number"),
        ("run PART --set smoother.magnetic.rounds=1001", "give a whole number up to 1000"),
        ("run PART --set smoother.known_lever=[1,2]", "give a list"),
        ("run PART --set smoother.gyro_bias_deg_s=[0,0,1e300]", "give a list"),
        ("run PART --set smoother.moving_foot=1", "give true or false"),
        ("run PART --set detector.detector=3", "give a word"),
        # fixes, places, calibrations
        ("run PART --fixes bad.fixes", "line 2 has no sigma above zero"),
        ("run PART --fixes late.fixes", "1000.00 s is outside the walk"),
        ("run PART --fixes none.csv", "none.csv does not exist"),
        ("run PART --method iez --fixes good.fixes", "iez makes no use of fixes"),
        ("run PART --places none", "none does not exist"),
        ("run BARE --save-places bare.places", "there is no magnetometer"),
        ("run PART --calibration cut.json", "cut.json"),
        ("run PART --calibration foreign.json", "foreign.json"),
        ("run PART --calibration none.json", "none.json"),
        # fields that cannot be looked at
        ("detect BARE --out out", "no magnetometer"),
        ("detect SLOW --out out", "10 Hz"),
        ("detect PART --gate magic", f"no gate 'magic' | {DEFAULT}"),
        ("detect PART --place nowhere", "nowhere"),
        ("detect PART --heading nan", "nan"),
        (f"detect PART --gate {SAMPLEWISE} --truth truth.tum", "--truth | no map"),
        ("detect PART --truth nowhere.tum", "nowhere.tum"),
        # what cannot be calibrated
        ("calibrate BARE --method walk --out c.json", "no magnetometer"),
        ("calibrate STRAIGHT --out c.json", "walk"),
        ("calibrate PART --method magic --out c.json", f"no method 'magic' | {' | '.join(METHODS)}"),
        ("calibrate STRAIGHT --strength 48 --out c.json", "'walk' | strength | ellipsoid"),
        ("calibrate TUMBLED --strength nan --out c.json", "nan"),
        ("calibrate TUMBLED --strength 48 --place 48,11,2025-01-01 --out c.json", "--strength | --place"),
        ("calibrate TUMBLED --place moon --out c.json", "moon"),
        ("calibrate nothing.csv --out c.json", "nothing.csv"),
        # two feet
        ("run PART MIRRORED --mount feet", "mirrored.csv: "),
        ("run PART BARE PART --mount feet", "takes two recordings | 3 of them"),
        ("run PART --mount feet", "takes two recordings | add the other one | no sensor to choose."),
        ("run PART PART --mount feet", "takes two recordings | one twice"),
        ("run PART BARE --mount feet --truth no.tum,nothing.tum", "no.tum"),
        # conversions
        ("convert PART out.xlsx", "out.xlsx | .csv, .csv.gz, .parquet"),
        ("convert PART PART --force", "is the file to read"),
        ("convert none.csv out.csv", "does not exist"),
        ("inspect PART --columns acc=1:2:3[g],gyr=4:5:6[deg/s] --format xio", "--columns maps a table"),
        # simulations
        ("simulate nowhere", "no scenario 'nowhere'"),
        ("simulate nowhere.toml", "nowhere.toml"),
        ("simulate demo --sensor sextant", "no sensor 'sextant'"),
        ("simulate demo --field swampy", "no field 'swampy'"),
        ("simulate demo --site atlantis", "no site"),
        ("simulate demo --rate -5", "rate_hz"),
        ("simulate demo --turn inf", "turned"),
        ("simulate demo --worn pocket --both-feet", "'pocket' has none opposite"),
        # files that are no recordings
        *((f"{verb} {name}", name) for verb in ("inspect", "run", "compare") for name in NO_RECORDINGS),
        # tables that leave something open
        ("inspect %counts", "acc is 2049.5 at rest, so it counts steps of a converter | acc=ax:ay:az[1/2048 g]"),
        ("inspect %still", "gyr ('gx' ... | names no unit | --columns \"time=t,acc=ax:ay:az,gyr=gx:gy:gz[UNIT]\""),
        ("inspect %swapped", "called gx, gy, gz measure gravity | acc=gx:gy:gz[m/s^2],gyr=ax:ay:az[UNIT]"),
        ("inspect %steps", "steps by 200. | and names no unit"),
        ("inspect %fast", "gyr ( | names no unit"),
        ("inspect %fives", "acc is 4.9 | at rest and names no unit"),
        ("inspect %twice", "more than one acceleration ('ax', 'ay', 'az', 'acc_x' | \"acc=NAME:NAME:NAME\" | --sensor"),
        ("inspect %feet", "more than one acceleration | 'right_ax'"),
        ("inspect %clocks", "more than one time ('time', 't') | \"time=NAME\""),
        ("inspect %linear", "acceleration without gravity | 'lin_acc_x'"),
        ("inspect %two", "not all three axes of angular rate, only 'gx', 'gy' | \"gyr=NAME:NAME:NAME"),
        ("inspect %pqr", "no column for angular rate among 't', 'ax', 'ay', 'az' | \"gyr=NAME:NAME:NAME[UNIT]\""),
        ("inspect %bare_file", "7 columns and no header | time=1,acc=2:3:4,gyr=5:6:7"),
        ("inspect %odd", "no column for acceleration among 'c0', 'c1'"),
        ("inspect %none", "no stamps: give its rate, such as --rate 100"),
        ("inspect %foot_print", "no recording but footprints | fg-nav run RECORDING --truth"),
        ("inspect %dot", "no rate of a DOT | --format xsens"),
        ("inspect %acc", "the tables of one recording into a folder of their own | fg-nav inspect FOLDER"),
        ("run %acc %gyro", "the tables of one recording into a folder of their own | fg-nav inspect FOLDER"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(fg_nav: FgNav, words: str, said: str) -> None:
    for name, text in TEXTS.items():
        Path(name).write_text(text)
    Path("raw.bin").write_bytes(bytes(range(256)))
    Path("taken").write_text("mine")
    arguments, before = [find(word) for word in words.split()], names(Path())
    ran = fg_nav(*arguments)
    assert ran.refused(*said.split(" | ")), ran
    check_proposals(fg_nav, arguments, ran)
    assert names(Path()) == before


@pytest.mark.skipif(CASES is None, reason="the small cases are not here")
@pytest.mark.parametrize("pattern", ["01*/feet*", "01*/sensor*", "02*/rows*", "17*/labels*"])
def test_what_is_said_of_a_case_can_be_typed(fg_nav: FgNav, pattern: str) -> None:
    (path,) = CASES.glob(pattern)
    ran = fg_nav("inspect", path)
    assert ran.refused(path.name)
    check_proposals(fg_nav, ["inspect", path], ran)
    for mapping in re.findall(r'--columns "(.*?)"', ran.err):
        fg_nav("inspect", path, "--columns", mapping.replace("UNIT", "deg/s")).succeeded()


def test_a_proposal_that_fails_is_found(fg_nav: FgNav) -> None:
    path = recorded("part")
    for words in (f"type fg-nav inspect {path} --sensor left.", "say which, such as `--columns t`.", "add --quieter."):
        with pytest.raises(AssertionError):
            check_proposals(fg_nav, ["inspect", path], Ran(1, "", f"fg-nav: {words}"))
    works = f"type fg-nav inspect {path} --json, or leave --rate out."
    assert check_proposals(fg_nav, ["inspect", path, "--rate", "9"], Ran(1, "", f"fg-nav: {works}")) == 2


@pytest.mark.parametrize("arguments", ["run", "run x --alignment best", "dance", "run x -q"])
def test_commands_not_understood_exit_with_2(fg_nav: FgNav, arguments: str) -> None:
    ran = fg_nav(*arguments.split())
    assert ran.code == 2
    assert "Usage" in ran.err
    assert "Traceback" not in ran.err


OWN_WALK = """
like = "office"
field = "smooth"
[course]
points_m = [[0, 0], [0, 12], [9, 12], [9, 0], [0, 0]]
rest_s = 3.0
[sensor]
rate_hz = 100.0
[sensor.gyr]
noise_density = 2e-4
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0, 12], [9, 12]", "[0, 12], [0, 12]", ["yard.toml"]),
        ("[[0, 0], [0, 12], [9, 12], [9, 0], [0, 0]]", "[[0, 0]]", ["point"]),
        ("2e-4", "-2e-4", ["noise_density"]),
        ("noise_density", "noisiness", ["no parameter 'noisiness'"]),
        ('"smooth"', '"swampy"', ["no field 'swampy'"]),
        ("rate_hz = 100.0", 'rate_hz = "fast"', ["sensor.rate_hz", "fast"]),
        ("[course]", "[curse]", ["course"]),
        ("like =", "like", ["no TOML"]),
        ("rest_s = 3.0", "rest_s = -3.0", ["-3"]),
        ("rest_s = 3.0", "strides = 9.0", ["strides", "9.0"]),
        ("[9, 0], [0, 0]]", "[9, 0]]\nlaps = 2", ["laps", "closed"]),
        ('"office"', "[1]", ["like", "[1]"]),
        ('field = "smooth"', "magnets = [[1, 2]]", ["magnets"]),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(fg_nav: FgNav, old: str, new: str, words: list[str]) -> None:
    assert old in OWN_WALK
    Path("yard.toml").write_text(OWN_WALK.replace(old, new))
    assert fg_nav("simulate", "yard.toml", "--out", "yard").refused("yard.toml", *words)
    assert not Path("yard").exists()
