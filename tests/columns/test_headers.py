"""What the names of columns and words of units say, one by one and of a whole table."""

import numpy as np
import pytest

from fg_nav.columns.headers import KNOWN_UNITS, find_factor, find_quantity, read_header
from fg_nav.columns.mapping import Hints, choose_columns, parse_columns, write_mapping
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2

HINTS = Hints("walk.csv", "fg-nav inspect walk.csv --columns")
PLAIN = ["t", "ax", "ay", "az", "gx", "gy", "gz"]


@pytest.mark.parametrize(
    ("kind", "axis", "unit", "names"),
    [
        ("acc", "x", "g", "Acc X [g]; AccX_g; acc_x_g; Acceleration_X(g); accel x g; a_x_g; gFx; ACC_X (g)"),
        ("acc", "x", None, "ax; accX; ACCX; accelerometer_x; imu0_ax; MPL_Accelerometer.x; acc[x]; a_x"),
        ("acc", "y", "m/s^2", "Acceleration y (m/s^2); acc_y [m/s^2]"),
        ("acc", "y", "m/s2", "acc_y_m_s2"),
        ("acc", "1", None, "acc1; acc_1; accel[1]"),
        ("gyr", "z", "deg/s", "gyro_z (deg/s); Gyr Z [deg/s]; GYR_Z[deg/s]"),
        ("gyr", "z", "dps", "gz_dps; AngularVelocityZ(dps)"),
        ("gyr", "z", None, "gz; wz; w_z; GyroZ; angular_velocity.z; angular_rate_z; ω_z; rotationRateZ"),
        ("gyr", "z", "rad/s", "gyr_z_rad_s; Omega_z (rad/s); motionRotationRateZ(rad/s); gyroRotationZ(rad/s)"),
        ("mag", "z", "uT", "mag_z_uT; magnetometer Z (uT); MAGNETIC FIELD Z (uT)"),
        ("mag", "z", None, "mz; Bz; MPL_Magnetic_Field.z; compass_z"),
        ("time", "", "ms", "Timestamp (ms); time_ms; t[ms]; millis; Time since start in ms; ms"),
        ("time", "", "s", "seconds_elapsed; time_s; elapsed (s)"),
        ("time", "", None, "t; time; timestamp; field.header.stamp; %time; SampleTimeFine"),
        ("counter", "", None, "sample; index; PacketCounter; packet number; n; frame; time_index"),
        ("no gravity", "x", None, "linear_acceleration.x; userAccelerationX; FreeAcc_X; lin_acc_x"),
    ],
)  # fmt: skip
def test_names(kind, axis, unit, names):
    for name in names.split("; "):
        meaning = read_header(name)
        assert meaning is not None, name
        assert (meaning.kind, meaning.axis, meaning.unit) == (kind, axis, unit), name


@pytest.mark.parametrize(
    "name",
    ["", "temperature", "qx", "vx", "pos_x", "orientation.x", "angular_velocity_covariance0", "roll",
     "max", "MPL_Rotation_Vector.x", "acc_norm", "ClipCountAcc", "position x", "lat", "héllo", "12", "()"],
)  # fmt: skip
def test_names_that_say_nothing(name):
    assert read_header(name) is None


def names_of(columns):
    return [channel and channel.names for channel in (columns.time, columns.acc, columns.gyr, columns.mag)]


def test_a_table_of_plain_letters():
    columns = choose_columns([*PLAIN, "temp"], HINTS)
    assert names_of(columns) == [("t",), ("ax", "ay", "az"), ("gx", "gy", "gz"), None]
    assert write_mapping(columns, acc="g", gyr="deg/s", time="ms") == "time=t[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s]"


def test_the_better_of_two_is_taken_in_any_order() -> None:
    """A clock by its name before one by its unit, calibrated before raw, gravity before none; unless ROS says so."""
    spare = [f"{what}_{a}" for what in ("lin_acc", "mag", "mag_raw") for a in "xyz"]
    ros = [f"field.{what}.{axis}" for what in ("linear_acceleration", "angular_velocity") for axis in "xyz"]
    numbered = ["gyr2 (deg/s)", "gyr0 (deg/s)", "gyr1 (deg/s)", "acc 3", "acc 2", "acc 1", "mag x [uT]", "sample"]
    feet = ["t", *(f"{foot}_{name}" for foot in ("left", "right") for name in PLAIN[1:])]
    for names, sensor, time, acc, gyr, mag in (
        (["exposure (ms)", "sampled (s)", *PLAIN], None, (2,), (3, 4, 5), (6, 7, 8), None),
        ([*PLAIN, "exposure (ms)", "sampled (s)"], None, (0,), (1, 2, 3), (4, 5, 6), None),
        (numbered, None, None, (5, 4, 3), (1, 2, 0), None),
        ([*PLAIN, *spare], None, (0,), (1, 2, 3), (4, 5, 6), (10, 11, 12)),
        (["field.header.stamp", "%time", *ros], None, (0,), (2, 3, 4), (5, 6, 7), None),
        (feet, "Right", (0,), (7, 8, 9), (10, 11, 12), None),
    ):
        columns = choose_columns(names, HINTS, sensor=sensor)
        found = (columns.time, columns.acc, columns.gyr, columns.mag)
        assert [channel and channel.positions for channel in found] == [time, acc, gyr, mag], names
    assert choose_columns(numbered, HINTS).gyr.unit == "deg/s"
    assert choose_columns(numbered, HINTS).counter is not None


def test_a_mapping_finds_names_in_any_case_and_without_their_unit():
    names = ["TS (ms)", "Acc X [g]", "Acc Y [g]", "Acc Z [g]", "a", "b", "c"]
    given = parse_columns("time=ts,acc=Acc X:acc y:ACC Z [g],gyr=5:6:c[deg/s]")
    columns = choose_columns(names, HINTS, given=given)
    assert columns.acc.positions == (1, 2, 3)
    assert (columns.time.unit, columns.acc.unit, columns.gyr.unit) == ("ms", "g", "deg/s")
    found = parse_columns("acc=Acc X [g]:Acc Y [g]:Acc Z [g],gyr=a:b:c").find(names, "walk.csv")
    assert found["acc"].positions == (1, 2, 3)
    mixed = ["Acc X [g]", "Acc Y [mg]", "Acc Z [g]"]  # of two units neither is that of all
    assert parse_columns("acc=1:2:3").find(mixed, "walk.csv")["acc"].unit is None
    # what a mapping leaves out is what the names say
    completed = choose_columns(names, HINTS, given=parse_columns("gyr=a:b:c[deg/s]"))
    assert (completed.acc, completed.time) == (columns.acc, columns.time)


def test_what_is_written_can_be_read():
    columns = choose_columns(
        ["Time [ms]", *(f"{what} {a}, {u}" for what, u in (("Acc", "g"), ("Gyr", "dps")) for a in "XYZ")], HINTS
    )
    words = write_mapping(columns)
    assert words == "time=1[ms],acc=2:3:4[g],gyr=5:6:7[dps]"
    assert parse_columns(words).units == {"time": "ms", "acc": "g", "gyr": "dps"}


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("acc=a:b:x,gyr=4:5:6", "no column 'x'.*it has 'a', 'b', 'c', 'd', 'd', 'f'"),
        ("acc=a:b:c,gyr=a:5:6", "'a' twice"),
        ("acc=a:b:c,gyr=d:5:6", "2 columns 'd'.*number"),
        ("acc=a:b:c,acc=a:b:c,gyr=4:5:6", "acc needs three columns.*, once"),
        ("hello=3", "no mapping"),
        ("time=1:2,acc=a:b:c,gyr=4:5:6", "time needs one column"),
        ("acc=1:2:9,gyr=4:5:6", "no column '9'"),
        ("t,ax,ay,az,gx,gy,gz", "lists 7 fields and walk.csv has 6"),
    ],
)  # fmt: skip
def test_mappings_that_fit_no_table(words, problem):
    with pytest.raises(FormatError, match=problem):
        parse_columns(words).find(["a", "b", "c", "d", "d", "f"], "walk.csv")


DEGREE = np.pi / 180


@pytest.mark.parametrize(
    ("quantity", "words", "factor"),
    [
        ("acc", "m/s^2, m/s², m/s2, m/(s^2), [m/s**2], M/S2, m/s/s, m s^-2, m·s⁻², meters/second^2, m/s�, m/sÂ²", 1.0),
        ("acc", "g, G, (g)", GRAVITY_M_S2),
        ("acc", "mg, milli g", 1e-3 * GRAVITY_M_S2),
        ("acc", "cm/s2, cm/s^2", 1e-2),
        ("gyr", "rad/s, rad s-1, radians per second, rad/sec, RAD/S, rad.s^-1", 1.0),
        ("gyr", "deg/s, °/s, º/s, dps, degrees/sec, Â°/s, �/s, deg_s-1", DEGREE),
        ("gyr", "mdps, mdeg/s", 1e-3 * DEGREE),
        ("mag", "uT, µT, μT, microtesla, Î¼T, �T, UT", 1.0),
        ("mag", "nT, nanoTesla", 1e-3),
        ("mag", "mT", 1e3),
        ("mag", "T, tesla", 1e6),
        ("mag", "G, gauss, Gs, Gauss", 100.0),
        ("mag", "mG, mgauss, milligauss", 0.1),
        ("time", "s, sec, seconds, (s)", 1.0),
        ("time", "ms, msec, milliseconds, millis", 1e-3),
        ("time", "us, µs, μs, usec, micros, microseconds", 1e-6),
        ("time", "ns, nanos", 1e-9),
        ("time", "min, minutes", 60.0),
    ],
)
def test_spellings(quantity, words, factor):
    for word in words.split(", "):
        assert find_factor(quantity, word) == pytest.approx(factor, rel=1e-15), word


def test_units_of_no_size_and_of_another_quantity():
    assert all(np.isnan(find_factor("mag", word)) for word in ("a.u.", "a.u", "arb. u.", "local_flux"))
    for quantity, word in (("acc", "deg/s"), ("gyr", "deg"), ("time", ""), ("mag", "furlong")):
        assert find_factor(quantity, word) is None


def test_units_without_a_quantity():
    assert [find_quantity(word) for word in ("ms", "g", "mg", "G", "mG", "deg/s", "uT", "counts")] == [
        *("time", "acc", "acc", "mag", "mag", "gyr", "mag"),
        None,
    ]


def test_the_words_of_messages_are_known():
    for quantity, words in KNOWN_UNITS.items():
        assert all(find_factor(quantity, word) for word in words.split(", "))
