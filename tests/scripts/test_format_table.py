"""The table of what becomes of foreign files."""

import numpy as np
import pytest

from tests.io.foreign_sensors import write_apdm, write_metawear, write_xsens_mt
from tests.io.samples import tilting
from tests.scripts import load_script

format_table = load_script("format_table")


def test_each_file_has_a_row_and_what_is_asked_for_is_given(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    raw = tilting(np.random.default_rng(1), duration_s=1.0, rate_hz=100.0, still_s=0.3)
    folder = tmp_path / "formats"
    for name in ("apdm", "xsens"):
        (folder / name).mkdir(parents=True)
    write_metawear(raw, folder / "metawear")
    write_apdm(raw, folder / "apdm" / "six.csv")
    write_xsens_mt(raw, folder / "xsens" / "left.txt")
    (folder / "xsens" / "notes.txt").write_text("walk|home\n")
    format_table.main(["--data", str(tmp_path)])
    six, both, left, notes, _, count = capsys.readouterr().out.splitlines()[2:]
    assert six.startswith("| apdm/six.csv | apdm | read with --sensor 'Left Foot' | 100 | 100.0 | 47.")
    assert both.startswith("| metawear | metawear | read | 100 | 100.0 | 47.")
    assert left.startswith("| xsens/left.txt | xsens | read | 99 | 100.0 | 47.4 | time is the packet counter")
    assert notes.startswith("| xsens/notes.txt |  | refused |  |  |  | notes.txt is ")
    assert count == "3 read, 0 unusable, 1 refused"
