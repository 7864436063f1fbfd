"""Samples in the text of a stream: a block and its lines read alike, whatever comes."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import FormatError, StreamError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.rows import Columns, RowReader, parse_columns
from tests.io.samples import tilting

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


@settings(max_examples=150, deadline=None)
@given(st.lists(lines, max_size=30), st.booleans(), st.data())
def test_the_samples_are_the_same_whatever_the_pieces(drawn, has_rate, draw):
    """In sum of all that a number may look like."""
    data = "\n".join(drawn).encode("utf-8", "surrogatepass") + b"\n"
    columns = Columns(("-", *CANONICAL[1:]), tuple(np.linspace(0.5, 2.0, 11).tolist()), 400.0) if has_rate else None
    readers = [RowReader("a test", columns=columns) for _ in range(2)]
    whole, cut = (b"" if columns else HEADER) + data, draw.draw(st.integers(0, len(data)))
    results = [readers[0].read(whole), np.concatenate([readers[1].read(whole[:cut]), readers[1].read(whole[cut:])])]
    assert results[0].tobytes() == results[1].tobytes()
    assert readers[0].bad == readers[1].bad
    assert readers[0].header == readers[1].header


def test_a_header_midway_in_another_order_is_used_from_there_on():
    """As of a sensor that was switched off and on with other software; one without the field has none."""
    reader = RowReader("a test")
    backward = (
        b",".join(reversed(HEADER.strip().split(b","))) + b"\n" + b",".join(reversed(ROW.strip().split(b","))) + b"\n"
    )
    without = b",".join(HEADER.strip().split(b",")[:7]) + b"\n" + b",".join(ROW.split(b",")[:7]) + b"\n"
    found = reader.read(HEADER + ROW + backward + without + HEADER + ROW)
    assert np.array_equal(found, [SAMPLE, SAMPLE, [*SAMPLE[:7], *[np.nan] * 4], SAMPLE], equal_nan=True)
    assert reader.bad == 0


def test_a_header_midway_without_its_end_changes_nothing():
    said = []
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER + ROW + HEADER[:50] + b"\n" + ROW)) == 2
    assert reader.bad == 1
    assert "no header" in said[0]


FOREIGN = b"ts_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx,my,mz,p\n"


@pytest.mark.parametrize("other", [FOREIGN, HEADER.replace(b"acc_z_m_s2", b"t_C").replace(b"gyr_x_rad_s", b"wx")])
@pytest.mark.parametrize("rows", [1, 1000])
def test_behind_a_header_of_other_names_rows_are_left_out_until_it_is_one_of_before(other, rows):
    """A logger that was restarted with other software: its columns are in another order, in other units."""
    said = []
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER + ROW + other + ROW * rows)) == 1
    assert len(reader.read(ROW * 3 + other + HEADER + ROW * rows)) == rows
    assert "names other columns" in said[0]
    assert reader.bad == rows + 5


def test_a_damaged_header_or_a_message_of_the_device_changes_nothing():
    rng = np.random.default_rng(1)
    reader = RowReader("a test")
    for odd in (HEADER.replace(b"acc_x", b"acc_q"), b"restarted, version 1.2\n", HEADER[:90] + b"\n", rng.bytes(10**5)):
        assert np.array_equal(reader.read(HEADER + ROW + odd + b"\n" + ROW), [SAMPLE] * 2)


def test_a_mapped_header_midway_in_another_order_is_used_from_there_on():
    reader = RowReader("a test", columns=parse_columns("time=t[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s]"))
    row, header = b"10,1,2,3,4,5,6\n", b"t,ax,ay,az,gx,gy,gz\n"
    turned, turned_header = b"4,5,6,10,1,2,3\n", b"gx,gy,gz,t,ax,ay,az\n"
    found = reader.read(header + row + turned_header + turned + b"gx,gy,gz,when,bx,by,bz\n" + turned + header + row)
    assert len(found) == 3
    assert np.array_equal(found, found[[0, 0, 0]], equal_nan=True)


@pytest.mark.parametrize("words", [SHORT_ROW, "time=1,acc=2:3:4,gyr=5:6:7"])
def test_where_columns_are_numbered_a_header_in_another_order_is_not_read_by_them(words):
    reader = RowReader("a test", columns=parse_columns(words))
    header, row = b"t,ax,ay,az,gx,gy,gz\n", b"1,0,0,9,1,2,3\n"
    assert len(reader.read(header + row + header + row)) == 2
    assert len(reader.read(b"t,gx,gy,gz,ax,ay,az\n" + row)) == 0
    assert len(reader.read(header + row)) == 1


@pytest.mark.parametrize("cut", [1, 7, 30])
def test_a_sender_that_began_before_is_read_from_its_next_header_on(cut):
    """Its first line may be the end of a row, or of a header, which then names the columns."""
    said = []
    reader = RowReader("a test", said.append)
    assert len(reader.read(HEADER[cut:] + ROW * 300)) == 300
    assert "no header came" in said.pop()
    reader = RowReader("a test", said.append)
    assert len(reader.read(ROW[cut:] + ROW * 15 + HEADER + ROW * 3)) == 3
    late = RowReader("a test", said.append)
    assert len(late.read(ROW * 400 + HEADER + ROW)) == 1
    assert len(said) == 1
    assert "--columns" in said[0]


def test_where_no_header_comes_it_is_said():
    with pytest.raises(FormatError, match="no header"):
        RowReader("a test").read(ROW * 10_000)
    with pytest.raises(FormatError, match="no column 'acc_y_m_s2'"):
        RowReader("a test").read(HEADER.replace(b"acc_y_m_s2", b"acc_y") + ROW * 30)
    with pytest.raises(FormatError, match="ended before"):
        RowReader("a test").finish()


@pytest.mark.parametrize("block", [1, 1000])
def test_columns_units_and_counted_stamps(block):
    columns = parse_columns("-,gz,gy,gx,ax,ay,az,-", "g,deg/s", 50.0)
    reader = RowReader("a test", columns=columns)
    row = b"words,3,2,1,0,0,1,\n" if block == 1 else b"7,3,2,1,0,0,1,8\n"
    found = reader.read(row * 2 * block)
    turn = np.radians([1.0, 2.0, 3.0])
    assert np.allclose(found[:, 1:7], [0, 0, GRAVITY_M_S2, *turn], rtol=1e-15, atol=0)
    assert np.array_equal(found[:, 0], np.arange(2 * block) / 50.0)
    assert np.isnan(found[:, 7:10]).all()
    after = reader.read(b"broken\n" + row, away_s=3.0)
    assert after[0, 0] == pytest.approx((2 * block + 1) / 50.0 + 3.0)


def test_stamps_and_field_in_other_units():
    reader = RowReader("a test", columns=parse_columns(f"{SHORT_ROW},mx,my,mz", "us,mgauss"))
    found = reader.read(b"2500000,0,0,9.8,0,0,0,200,0,400\n")[0]
    assert found[[0, 3, 7, 9]] == pytest.approx([2.5, 9.8, 20.0, 40.0])


@pytest.mark.parametrize("block", [1, 1000])
def test_a_mapping_finds_the_names_of_a_header_that_is_not_ours(block):
    words = "time=ts[ms],acc=A_x:A_y:A_z[g],gyr=w1:w2:w3[deg/s]"
    reader = RowReader("a test", columns=parse_columns(words))
    found = reader.read(b"# hello\nts,w3,w2,w1,note,A_x,A_y,A_z\n" + b"2500,3,2,1,0,0,0,1\n" * block)
    assert len(found) == block
    assert np.allclose(found[0, :7], [2.5, 0, 0, GRAVITY_M_S2, *np.radians([1, 2, 3])], rtol=1e-15, atol=0)


def test_a_mapping_by_numbers_needs_no_header_and_passes_one_over():
    reader = RowReader("a test", columns=parse_columns("acc=2:3:4[mg],gyr=7:6:5,mag=8:9:10[G]", None, 50.0))
    found = reader.read(b"id,a,a,a,g,g,g,m,m,m\n" + b"7,0,0,1000,3,2,1,0.2,0,0.4\n" * 2)
    assert found[-1, :10] == pytest.approx([1 / 50.0, 0, 0, GRAVITY_M_S2, 1, 2, 3, 20.0, 0, 40.0])
    reader.resume(["-"] * 10)
    assert reader.header is not None


def test_a_mapping_that_finds_nothing_is_refused_with_its_name():
    reader = RowReader("a test", columns=parse_columns("time=ts,acc=a:b:c,gyr=d:e:f"))
    with pytest.raises(FormatError, match="no column 'a' of --columns: it has 'ts', 'acc_x"):
        reader.read(HEADER.replace(b"time_s", b"ts") * 30)


def test_a_header_is_believed_before_columns():
    """What comes with the rows is of them."""
    reader = RowReader("a test", columns=parse_columns(SHORT_ROW, "ms,g"))
    found = reader.read(b"1000,0,0,1,0,0,0\n" + HEADER + ROW)
    assert found[0, [0, 3]] == pytest.approx([1.0, GRAVITY_M_S2])
    assert np.array_equal(found[1], SAMPLE)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("t,ax,ay", None, None), "lacks az,gx,gy,gz"),
        ((f"{SHORT_ROW},mx", None, None), "lacks my,mz"),
        ((f"{SHORT_ROW},ax", None, None), "twice"),
        ((f"{SHORT_ROW},temp", None, None), "'temp'"),
        (("", None, None), "--columns"),
        (("acc=1:2:3,gyr=4:5:6", None, None), "no time"),
        (("acc=1:2:3,gyr=4:5:6", "g", 100.0), "in brackets"),
        (("acc=1:2:3[furlong],gyr=4:5:6", None, 100.0), "no unit 'furlong' of acc"),
        (("acc=1:2,gyr=4:5:6", None, 100.0), "three columns"),
        (("time=1,acc=1:2:3", None, None), "lacks gyr"),
        ((SHORT_ROW[2:], None, None), "--rate"),
        ((SHORT_ROW, None, 400.0), "--rate"),
        ((SHORT_ROW[2:], None, 0.0), "--rate 0"),
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
    for _ in range(160):
        reader.read(piece)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6
    assert reader.bad == 1
    assert np.array_equal(reader.read(end + b"\n" + ROW), [SAMPLE])


def resumed_reader(header):
    reader = RowReader("a test")
    reader.resume(header)
    return reader


def test_a_header_that_comes_again_names_the_same_columns():
    header, rows = HEADER, [ROW, ROW.replace(b"20", b""), ROW]
    names = header.decode().strip().split(",")
    reader = resumed_reader(names)
    turned = [b",".join(reversed(row.strip().split(b","))) + b"\n" for row in (header, *rows)]
    assert np.array_equal(
        reader.read(b"".join(turned)), RowReader("a test").read(b"".join([header, *rows])), equal_nan=True
    )
    with pytest.raises(FormatError, match="other columns"):
        resumed_reader(names).read(b",".join(HEADER.split(b",")[:7]) + b"\n")
    half = resumed_reader(names).read(rows[0][10:] + rows[1])
    assert np.array_equal(half, RowReader("a test").read(header + rows[1]), equal_nan=True)


def test_rows_are_read_in_any_order_and_ending():
    one = b"time_s,acc_z_m_s2,acc_x_m_s2,acc_y_m_s2,note,gyr_x_rad_s,gyr_y_rad_s,gyr_z_rad_s,\r\n"
    reader = RowReader("a test")
    rows = reader.read(b"junk of before\n\xef\xbb\xbf" + one + b"1, 9.8,0.1,,words,1,2,3,\r\n2,9")
    assert np.array_equal(rows[0, :7], [1, 0.1, np.nan, 9.8, 1, 2, 3], equal_nan=True)
    assert np.isnan(rows[0, 7:10]).all()
    assert len(reader.finish()) == 0
    assert reader.bad == 1


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
    short = RowReader("a test")
    np.testing.assert_allclose(
        np.concatenate([short.read(lines[:20000]), short.finish()])[50, :7], table[50, :7], atol=1e-6
    )


def test_rows_without_a_header_that_are_no_samples_in_si_are_still_refused() -> None:
    own = tilting(np.random.default_rng(6), duration_s=6.0, rate_hz=100.0)
    table = np.column_stack([own.t, own.acc / 9.8, own.gyr])
    reader = RowReader("a test")
    lines = "".join(",".join(f"{value:.6f}" for value in row) + "\n" for row in table.tolist()).encode()
    assert not len(reader.read(lines))
    with pytest.raises(FormatError, match="ended before a header came"):
        reader.finish()


def test_a_row_that_a_signal_cut_off_is_no_sample_and_no_fault():
    """Its last number may be short of digits: 9.8 of 9.81."""
    remarks = []
    reader = RowReader("a test", remarks.append)
    assert len(reader.read(HEADER + ROW + ROW[:20])) == 1
    assert len(reader.finish(is_cut=True)) == 0
    assert reader.bad == 0
    assert not remarks
