"""Samples in the text of a stream: a block and its lines read alike, whatever comes."""

import re
import shutil
import subprocess
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import FormatError, StreamError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import rows_of
from fg_nav.online.rows import Columns, RowReader, parse_columns
from tests.io.samples import tilting
from tests.online.walks import short_walk

HEADER = ",".join(CANONICAL).encode() + b"\n"
ROW = b"1.5,0.1,0.2,9.8,1,2,3,20,-3,40,101325\n"
SAMPLE = [1.5, 0.1, 0.2, 9.8, 1, 2, 3, 20, -3, 40, 101325]
SHORT_ROW = "t,ax,ay,az,gx,gy,gz"

ODD = (
    "", " ", "+.5", "1e999", "1e-400", "4.9e-324", "1_0", "nan", "-Inf", "0x1", "1e", "--1", "NA", "'", "true",
    "\u0661", "\"1\"", "\xa01", "1\x00", "9007199254740993", "1" * 400,
)  # fmt: skip
numbers = st.one_of(
    st.floats().map(repr), st.floats(-100, 100).map("{:.6f}".format), st.integers().map(str), st.sampled_from(ODD)
)
plain = st.lists(numbers, min_size=11, max_size=11).map(",".join)
headers = (
    "time_s,acc_x_m_s2", ",".join(CANONICAL), ",".join(reversed(CANONICAL)), "time_s,a,b,c,d,e,f,g,h,i",
    "t,a,b,c,d,e,f,g,h,i",
)  # fmt: skip
lines = st.one_of(
    plain, plain, plain.map(lambda row: row + "\r"), plain.map(lambda row: row + ","),
    st.sampled_from(["", "\r", " ", ",", "\ufeff", *headers]), st.text(max_size=30),
)  # fmt: skip


@settings(max_examples=80, deadline=None)
@given(st.lists(lines, max_size=30), st.booleans(), st.data())
def test_the_samples_are_the_same_whatever_the_pieces(drawn, has_rate, draw):
    data = "\n".join(drawn).encode("utf-8", "surrogatepass") + b"\n"
    columns = Columns(("-", *CANONICAL[1:]), tuple(np.linspace(0.5, 2.0, 11).tolist()), 400.0) if has_rate else None
    readers = [RowReader("a test", columns=columns) for _ in range(2)]
    whole, cut = (b"" if columns else HEADER) + data, draw.draw(st.integers(0, len(data)))
    results = [readers[0].read(whole), np.concatenate([readers[1].read(whole[:cut]), readers[1].read(whole[cut:])])]
    assert results[0].tobytes() == results[1].tobytes()
    assert readers[0].bad == readers[1].bad
    assert readers[0].header == readers[1].header


def test_a_header_midway_in_another_order_is_used_from_there_on():
    reader = RowReader("a test")
    backward = (
        b",".join(reversed(HEADER.strip().split(b","))) + b"\n" + b",".join(reversed(ROW.strip().split(b","))) + b"\n"
    )
    without = b",".join(HEADER.strip().split(b",")[:7]) + b"\n" + b",".join(ROW.split(b",")[:7]) + b"\n"
    found = reader.read(HEADER + ROW + backward + without + HEADER + ROW)
    assert np.array_equal(found, [SAMPLE, SAMPLE, [*SAMPLE[:7], *[np.nan] * 4], SAMPLE], equal_nan=True)
    assert reader.bad == 0
    reader = RowReader("a test", columns=parse_columns("time=t[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s]"))
    row, turned = b"t,ax,ay,az,gx,gy,gz\n10,1,2,3,4,5,6\n", b"gx,gy,gz,t,ax,ay,az\n4,5,6,10,1,2,3\n"
    found = reader.read(row + turned + b"gx,gy,gz,when,bx,by,bz\n4,5,6,10,1,2,3\n" + row)
    assert np.array_equal(found, found[[0, 0, 0]], equal_nan=True)


FOREIGN = b"ts_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx,my,mz,p\n"


@pytest.mark.parametrize(
    ("other", "rows"), [(FOREIGN, 1000), (HEADER.replace(b"acc_z_m_s2", b"t_C").replace(b"gyr_x_rad_s", b"wx"), 1)]
)
def test_behind_a_header_of_other_names_rows_are_left_out_until_it_is_one_of_before(other, rows):
    """A logger that was restarted with other software: its columns are in another order, in other units."""
    said = []
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER + ROW + other + ROW * rows)) == 1
    assert len(reader.read(ROW * 3 + other + HEADER + ROW * rows)) == rows
    assert "names other columns" in said[0]
    assert reader.bad == rows + 5


def test_a_damaged_header_or_a_message_of_the_device_changes_nothing():
    rng, said = np.random.default_rng(1), []
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER + ROW + HEADER[:50] + b"\n" + ROW)) == 2
    assert reader.bad == 1
    assert "no header" in said[0]
    for odd in (HEADER.replace(b"acc_x", b"acc_q"), b"restarted, version 1.2\n", HEADER[:90] + b"\n", rng.bytes(10**5)):
        assert np.array_equal(reader.read(HEADER + ROW + odd + b"\n" + ROW), [SAMPLE] * 2)


@pytest.mark.parametrize("cut", [1, 7, 30])
def test_a_sender_that_began_before_is_read_from_its_next_header_on(cut):
    """Its first line may be the end of a row, or of a header, which then names the columns."""
    said = list[str]()
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER[cut:] + ROW * 300)) == 300
    assert "no header came" in said.pop()
    reader = RowReader("a test", said.append)
    assert len(reader.read(ROW[cut:] + ROW * 15 + HEADER + ROW * 3)) == 3
    assert len(RowReader("a test", said.append).read(ROW * 400 + HEADER + ROW)) == 1
    assert ["--columns" in words for words in said] == [True]


def test_where_no_header_comes_it_is_said():
    with pytest.raises(FormatError, match="no header"):
        RowReader("a test").read(ROW * 10_000)
    with pytest.raises(FormatError, match="no column 'acc_y_m_s2'"):
        RowReader("a test").read(HEADER.replace(b"acc_y_m_s2", b"acc_y") + ROW * 30)
    with pytest.raises(FormatError, match="ended before"):
        RowReader("a test").finish()
    reader = RowReader("a test", columns=parse_columns("time=ts,acc=a:b:c,gyr=d:e:f"))
    with pytest.raises(FormatError, match="no column 'a' of --columns: it has 'ts', 'acc_x"):
        reader.read(HEADER.replace(b"time_s", b"ts") * 30)


TURN = np.radians([1.0, 2.0, 3.0])
NAN = [np.nan] * 3


@pytest.mark.parametrize("block", [1, 1000])
@pytest.mark.parametrize(
    ("words", "text", "first"),
    [
        (
            (f"{SHORT_ROW},mx,my,mz", "us,mgauss"),
            b"2500000,0,0,9.8,0,0,0,200,0,400\n",
            [2.5, 0, 0, 9.8, 0, 0, 0, 20, 0, 40],
        ),
        (
            ("time=ts[ms],acc=A_x:A_y:A_z[g],gyr=w1:w2:w3[deg/s]",),
            b"# hello\nts,w3,w2,w1,note,A_x,A_y,A_z\n2500,3,2,1,0,0,0,1\n",
            [2.5, 0, 0, GRAVITY_M_S2, *TURN, *NAN],
        ),
        (
            ("acc=2:3:4[mg],gyr=7:6:5,mag=8:9:10[G]", None, 50.0),
            b"id,a,a,a,g,g,g,m,m,m\n7,0,0,1000,3,2,1,0.2,0,0.4\n",
            [0, 0, 0, GRAVITY_M_S2, 1, 2, 3, 20.0, 0, 40.0],
        ),
        ((SHORT_ROW, "ms,g"), b"1000,0,0,1,0,0,0\n", [1, 0, 0, GRAVITY_M_S2, 0, 0, 0, *NAN]),
    ],
    ids=["units", "names of another header", "numbers", "units of a row"],
)
def test_columns_are_mapped_and_brought_to_si(words, text, first, block):
    reader = RowReader("a test", columns=parse_columns(*words))
    found = reader.read(text + text.splitlines(keepends=True)[-1] * (block - 1))
    assert len(found) == block
    np.testing.assert_allclose(found[0, :10], first, rtol=1e-15)
    assert np.array_equal(reader.read(HEADER + ROW), [SAMPLE])  # a header of ours is believed before columns


def test_counted_stamps_go_on_behind_what_is_broken_and_what_was_away():
    reader = RowReader("a test", columns=parse_columns("-,gz,gy,gx,ax,ay,az,-", "g,deg/s", 50.0))
    row = b"words,3,2,1,0,0,1,\n"
    found = np.concatenate([reader.read(row), reader.read(row.replace(b"words", b"7") * 1000)])
    assert np.allclose(found[:, 1:7], [0, 0, GRAVITY_M_S2, *TURN], rtol=1e-15, atol=0)
    assert np.array_equal(found[:, 0], np.arange(1001) / 50.0)
    assert np.isnan(found[:, 7:10]).all()
    after = reader.read(b"broken\n" + row, away_s=3.0)
    assert after[0, 0] == pytest.approx(1002 / 50.0 + 3.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("t,ax,ay", None, None), "lacks az,gx,gy,gz"),
        ((f"{SHORT_ROW},ax", None, None), "twice"),
        ((f"{SHORT_ROW},temp", None, None), "'temp'"),
        (("", None, None), "--columns"),
        (("acc=1:2:3,gyr=4:5:6", None, None), "no time"),
        (("acc=1:2:3[furlong],gyr=4:5:6", None, 100.0), "no unit 'furlong' of acc"),
        (("acc=1:2,gyr=4:5:6", None, 100.0), "three columns"),
        ((SHORT_ROW[2:], None, None), "--rate"),
        ((SHORT_ROW, None, 400.0), "--rate"),
        ((SHORT_ROW, "furlong", None), "'furlong'"),
        ((SHORT_ROW, "s,ms", None), "two units"),
        ((None, "g", None), "--units"),
        ((None, None, 400.0), "--rate"),
    ],
)
def test_columns_that_are_none_are_refused(given, words):
    with pytest.raises(StreamError, match=words):
        parse_columns(*given)


@pytest.mark.parametrize("end", [b"", b"\n"], ids=["for ever", "with an end"])
def test_a_line_of_any_length_costs_no_memory_and_one_row(end):
    reader = RowReader("a test")
    reader.read(HEADER)
    piece = b"0" * (1 << 16)
    tracemalloc.start()
    for _ in range(40):
        reader.read(piece)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6
    assert reader.bad == 1
    assert np.array_equal(reader.read(end + b"\n" + ROW), [SAMPLE])


def test_a_header_that_comes_again_names_the_same_columns():
    header, rows = HEADER, [ROW, ROW.replace(b"20", b""), ROW]
    names = header.decode().strip().split(",")

    def resumed():
        reader = RowReader("a test")
        reader.resume(names)
        return reader

    turned = [b",".join(reversed(row.strip().split(b","))) + b"\n" for row in (header, *rows)]
    expected = RowReader("a test").read(b"".join([header, *rows]))
    assert np.array_equal(resumed().read(b"".join(turned)), expected, equal_nan=True)
    with pytest.raises(FormatError, match="other columns"):
        resumed().read(b",".join(HEADER.split(b",")[:7]) + b"\n")
    assert np.array_equal(resumed().read(rows[0][10:] + rows[1]), expected[1:2], equal_nan=True)


def test_rows_are_read_in_any_order_and_what_is_cut_off_at_the_end_is_no_sample():
    """Its last number may be short of digits; it is no fault where a signal cut it off."""
    one = b"time_s,acc_z_m_s2,acc_x_m_s2,acc_y_m_s2,note,gyr_x_rad_s,gyr_y_rad_s,gyr_z_rad_s,\r\n"
    for is_cut in (False, True):
        reader = RowReader("a test")
        rows = reader.read(b"junk of before\n\xef\xbb\xbf" + one + b"1, 9.8,0.1,,words,1,2,3,\r\n2,9")
        assert np.array_equal(rows[0, :10], [1, 0.1, np.nan, 9.8, 1, 2, 3, *NAN], equal_nan=True)
        assert len(reader.finish(is_cut=is_cut)) == 0
        assert reader.bad == 1 - is_cut


@pytest.mark.parametrize("width", [7, 10, 11])
def test_a_header_that_was_lost_is_found_by_physics_and_no_row_is(width: int) -> None:
    own = tilting(np.random.default_rng(6), duration_s=6.0, rate_hz=100.0)
    air = 101325.0 + np.arange(len(own.t)) % 7
    table = np.column_stack([own.t, own.acc, own.gyr, own.mag, air])[:, :width]
    said: list[str] = []
    reader = RowReader("a test", said.append)
    lines = "".join(",".join(f"{value:.6f}" for value in row) + "\n" for row in table.tolist()).encode()
    rows = np.concatenate([reader.read(lines[at : at + 997]) for at in range(0, len(lines), 997)] + [reader.finish()])
    np.testing.assert_allclose(rows[:, :width], table, atol=1e-6)
    assert any(f"its {width} fields are taken for time_s" in words for words in said)
    in_g = RowReader("a test")  # no samples in SI
    of_g = np.column_stack([own.t, own.acc / 9.8, own.gyr]).tolist()
    assert not len(in_g.read("".join(",".join(f"{value:.6f}" for value in row) + "\n" for row in of_g).encode()))
    with pytest.raises(FormatError, match="ended before a header came"):
        in_g.finish()


# --- of the microcontroller in the documentation ---------------------------------------------------------------------


PAGE = Path(__file__).parents[2] / "docs/microcontroller.md"
(PROGRAM,) = re.findall(r"```cpp\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
ACC, GYR = GRAVITY_M_S2 / 2048, np.radians(2000.0) / 32768
"""Of a count, m/s^2 and rad/s: ranges of 16 g and 2000 deg/s in 16 bits with a sign."""

BOARD = r"""
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
enum { WL_CONNECTED = 3 };
static int64_t clock_us = 0;
int64_t esp_timer_get_time() { return clock_us += 7; }
void delay(int) {}
struct { void begin(const char *, const char *) {} int status() { return WL_CONNECTED; } } WiFi;
struct {
  int settings[256] = {}, sent[8], count = 0, place = 0;
  unsigned char bytes[14];
  void begin() {}
  void setClock(int) {}
  void beginTransmission(int address) { if (address != 0x68) exit(2); count = 0; }
  void write(int value) { sent[count++] = value; }
  void endTransmission(bool stop = true) { if (stop && count == 2) settings[sent[0]] = sent[1]; }
  void requestFrom(int address, int n) {
    bool is_ready = settings[0x6B] == 1 && settings[0x1B] == 0x18 && settings[0x1C] == 0x18;
    if (address != 0x68 || sent[0] != 0x3B || n != 14 || !is_ready) exit(3);
    if (fread(bytes, 1, 14, stdin) != 14) exit(0);
    place = 0;
  }
  int read() { return bytes[place++]; }
} Wire;
struct WiFiUDP {
  void beginPacket(const char *, int) {}
  void write(const uint8_t *data, int n) { fwrite(data, 1, n, stdout); }
  void endPacket() { fflush(stdout); }
};
#include "sketch.ino"
int main() { setup(); for (;;) loop(); }
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_it_sends_what_the_sensor_measured(tmp_path):
    # Registers of the sensor on a short walk, (N, 7): acc, temperature, gyr.
    walk = rows_of(short_walk())
    both = np.column_stack([walk[:, 1:4] / ACC, np.full(len(walk), 777.0), walk[:, 4:7] / GYR])
    counts = np.clip(np.rint(both), -32768, 32767).astype(">i2")[: len(walk) // 4 * 4]
    for name in ("WiFi.h", "WiFiUdp.h", "Wire.h"):
        (tmp_path / name).write_text("")
    (tmp_path / "sketch.ino").write_text(PROGRAM)
    (tmp_path / "board.cpp").write_text(BOARD)
    subprocess.run(["g++", "-std=c++17", "-I.", "board.cpp", "-o", "board"], cwd=tmp_path, check=True)
    sent = subprocess.run([tmp_path / "board"], input=counts.tobytes(), capture_output=True, check=True).stdout
    reader = RowReader("the microcontroller")
    rows = reader.read(sent)
    assert reader.bad == 0
    assert sent.count(b"time_s") == len(counts) // 4
    assert np.allclose(rows[:, 1:4], counts[:, :3] * ACC, atol=6e-6, rtol=0)
    assert np.allclose(rows[:, 4:7], counts[:, 4:] * GYR, atol=6e-7, rtol=0)
    assert np.isnan(rows[:, 7:10]).all()
    assert np.allclose(np.diff(rows[:, 0]), 0.0025, atol=2e-5)
    assert len(PROGRAM.splitlines()) <= 35
