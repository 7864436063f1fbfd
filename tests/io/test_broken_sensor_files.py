"""Whatever is broken in a file of a sensor maker's tool, only an `FgNavError` of one line comes out of reading it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.errors import FgNavError
from fg_nav.io import read_raw
from fg_nav.recording import Recording
from tests.io.foreign_sensors import FOREIGN
from tests.io.samples import tilting
from tests.io.test_broken_files import RELAXED, damage, is_a_line, scrambled

FEW = settings(RELAXED, max_examples=8)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    raw = tilting(np.random.default_rng(5), duration_s=0.4, rate_hz=100.0, still_s=0.1)
    path = tmp_path_factory.mktemp("whole") / "walk.dat"
    files = {}
    for kind, how in FOREIGN.items():
        how.write(raw, path)
        files[kind] = path.read_bytes()
    return files


@pytest.mark.parametrize("kind", FOREIGN)
@FEW
@given(data=st.data())
def test_damaged(kind: str, data: st.DataObject, whole: dict[str, bytes], tmp_path: Path) -> None:
    separator = ";" if kind.startswith("shimmer") else "\t" if kind == "xsens" else ","
    broken = st.one_of(damage(whole[kind]), scrambled(whole[kind].decode(), separator))
    path = tmp_path / "walk.csv"
    path.write_bytes(data.draw(broken))
    for name in (None, FOREIGN[kind].format):
        try:
            Recording.from_raw(read_raw(path, name, sensor=FOREIGN[kind].sensor))
        except FgNavError as error:
            is_a_line(error)
