"""What a stream stands: how lines and rows are compared."""

from pathlib import Path

import numpy as np

from tests.scripts import load_script

stress = load_script("stress")


def test_lines_of_a_walk_that_was_killed_are_compared_wherever_they_were_told() -> None:
    lines = [{"kind": "now", "stance": k, "t": k} for k in range(3)]
    lines += [{"kind": "smoothed", "position_m": [k, 0.5], "position_sigma_m": [0.5, 0.5]} for k in range(3)]
    assert stress.compare_lines(lines, lines) == (0, 0, 0.0)
    assert stress.compare_lines(lines, [*lines, *lines[1:3]]) == (0, 2, 0.0)
    assert stress.compare_lines(lines, [*lines[1:5], {**lines[5], "position_m": [2, 0.75]}]) == (1, 0, 0.5)
    assert stress.compare_lines(lines, lines[:4]) == (0, 0, np.inf)


def test_rows_that_are_missing_are_counted(tmp_path: Path) -> None:
    lines = [b"%.4f,0.1,0.2,9.8,0.01,0.02,0.03,20,1,-40\n" % (k / 400.0) for k in range(200)]
    (tmp_path / "record.csv").write_bytes(stress.HEADER + b"".join(lines[::2]))
    assert stress.compare_rows(lines, tmp_path / "record.csv") == 100
