"""Whatever a file holds, only `FgNavError` comes out of reading, inspecting and taking it for truth."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fg_nav.errors import FgNavError
from fg_nav.inspection import inspect
from fg_nav.io import FORMATS, read, read_raw, read_truth, write_tum
from tests.io.samples import WRITERS, tilting
from tests.scripts import load_script

mutations = load_script("fuzz.mutations")

RELAXED = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

SEEDS = st.integers(0, 2**32 - 1)


def damage(whole: bytes) -> st.SearchStrategy[bytes]:
    """Break a file in one to three ways, as `scripts/fuzz/run.py` does."""
    return SEEDS.map(lambda seed: mutations.mutate_bytes(whole, np.random.default_rng(seed))[0])


def scrambled(whole: str, separator: str = "") -> st.SearchStrategy[bytes]:
    """Break a table: drop columns and lines, swap lines, replace fields."""
    return SEEDS.map(
        lambda seed: mutations.scramble_table(whole, np.random.default_rng(seed), separator).encode("utf-8", "replace")
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Valid files of every kind, a quarter of a second long."""
    raw = tilting(np.random.default_rng(5), duration_s=0.25, still_s=0.1)
    folder = tmp_path_factory.mktemp("whole")
    files = {}
    for kind, (_, writer) in WRITERS.items():
        path = folder / "walk.mat"
        writer(raw, path)
        files[kind] = path.read_bytes()
    path = folder / "truth.tum"
    write_tum(path, raw.t, raw.acc, np.tile(np.eye(3), (len(raw.t), 1, 1)))
    return {**files, "tum": path.read_bytes(), "footprints": b"stride,x_m,y_m\n0,0,0\n1,1.5,2\n2,3,4\n"}


def _swallow(data: bytes, path: Path) -> None:
    """Read a file as what it is, and as some of all formats. Anything but an `FgNavError` fails the test."""
    path.write_bytes(data)
    names = sorted(FORMATS)
    first = zlib.crc32(data) % len(names)
    for name in (None, *(names + names)[first : first + 3]):
        try:
            raw = read_raw(path, name)
        except FgNavError as error:
            is_a_line(error)
            continue
        assert all("\n" not in sentence for sentence in inspect(raw).verdict)
    for reader in (read, read_truth):
        try:
            reader(path)
        except FgNavError as error:
            is_a_line(error)


def is_a_line(error: FgNavError) -> None:
    assert str(error)
    assert "\n" not in str(error)


@pytest.mark.parametrize("kind", [*WRITERS, "tum", "footprints"])
@RELAXED
@given(data=st.data())
def test_damaged_bytes(kind: str, data: st.DataObject, whole: dict[str, bytes], tmp_path: Path) -> None:
    _swallow(data.draw(damage(whole[kind])), tmp_path / "walk.csv")


@pytest.mark.parametrize("kind", ["canonical", "sensorconnect", "estimated", "xio", "openshoe", "tum", "footprints"])
@RELAXED
@given(data=st.data())
def test_scrambled_tables(kind: str, data: st.DataObject, whole: dict[str, bytes], tmp_path: Path) -> None:
    _swallow(data.draw(scrambled(whole[kind].decode())), tmp_path / "walk.csv")


@RELAXED
@given(data=st.one_of(st.binary(max_size=600), st.text(max_size=300).map(str.encode)))
def test_anything(data: bytes, tmp_path: Path) -> None:
    _swallow(data, tmp_path / "walk.csv")


@RELAXED
@given(tail=st.binary(max_size=600))
def test_anything_that_begins_like_a_known_file(tail: bytes, whole: dict[str, bytes], tmp_path: Path) -> None:
    for data in whole.values():
        _swallow(data[:140] + tail, tmp_path / "walk.csv")
