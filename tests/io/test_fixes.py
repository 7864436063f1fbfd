"""Files of fixes: what is read, and what is refused in one sentence."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import read_fixes

HEADER = "time_s,x_m,y_m,z_m,sigma_m"


def written(folder: Path, *lines: str) -> Path:
    path = folder / "fixes.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_fixes_are_read_and_an_empty_height_is_not_known(tmp_path: Path) -> None:
    flat, full = read_fixes(written(tmp_path, HEADER, "12.5,3,-4,,0.2", "20,1,2,3.5,1"))
    assert (flat.time_s, flat.horizontal_sigma_m, flat.vertical_sigma_m) == (12.5, 0.2, np.inf)
    np.testing.assert_array_equal(flat.position, [3.0, -4.0, 0.0])
    assert (full.time_s, full.horizontal_sigma_m, full.vertical_sigma_m) == (20.0, 1.0, 1.0)
    np.testing.assert_array_equal(full.position, [1.0, 2.0, 3.5])


def test_columns_are_found_by_name(tmp_path: Path) -> None:
    (fix,) = read_fixes(written(tmp_path, "sigma_m,point,z_m,y_m,x_m,time_s", "0.1,A,7,6,5,4"))
    assert (fix.time_s, *fix.position, fix.horizontal_sigma_m) == (4.0, 5.0, 6.0, 7.0, 0.1)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["time_s,x_m,y_m,sigma_m", "1,2,3,4"], "no column 'z_m'"),
        ([HEADER], "no samples"),
        ([HEADER, "1,2,3,4,0.1", "2,three,3,,1"], "line 3, column 'x_m'"),
        ([HEADER, "1,2,3,4,0.1", "2,,3,,1"], "line 3 lacks a number"),
        ([HEADER, "1,2,3,inf,0.1"], "line 2 lacks a number"),
        ([HEADER, "1,2,3,,"], "line 2 lacks a number"),
        ([HEADER, "1,2,3,,1", "", "1,2,3,,0"], "line 4 has no sigma above zero"),
    ],
)
def test_what_is_no_fix_is_refused(tmp_path: Path, lines: list[str], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        read_fixes(written(tmp_path, *lines))
