"""Whatever a file holds, only `FgNavError` comes out of reading, inspecting and taking it for truth, in one line."""

from __future__ import annotations

import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fg_nav.errors import FgNavError
from fg_nav.inspection import inspect
from fg_nav.io import FORMATS, read_raw, read_truth, write_tum
from fg_nav.recording import Recording
from tests.io.every_format import SAMPLES, files_of
from tests.io.samples import tilting
from tests.scripts import load_script

mutations = load_script("fuzz.mutations")

RELAXED = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

SEEDS = st.integers(0, 2**32 - 1)
SHORT = tilting(np.random.default_rng(5), duration_s=0.4, rate_hz=100.0, still_s=0.1)


def damage(whole: bytes) -> st.SearchStrategy[bytes]:
    """Break a file in one to three ways, as `scripts/fuzz/run.py` does."""
    return SEEDS.map(lambda seed: mutations.mutate_bytes(whole, np.random.default_rng(seed))[0])


def scrambled(whole: str, separator: str = "") -> st.SearchStrategy[bytes]:
    """Break a table: drop columns and lines, swap lines, replace fields."""
    return SEEDS.map(
        lambda seed: mutations.scramble_table(whole, np.random.default_rng(seed), separator).encode("utf-8", "replace")
    )


def is_a_line(error: FgNavError) -> None:
    assert str(error)
    assert "\n" not in str(error)


def _swallow(path: Path, sensor: str | None = None, *formats: str) -> None:
    """Read a file as what it is, as others, and as a truth. Anything but an `FgNavError` fails the test."""
    for name in (None, *formats, "truth"):
        try:
            if name == "truth":
                read_truth(path)
                continue
            raw = read_raw(path, name, sensor=sensor)
            assert all("\n" not in sentence for sentence in inspect(raw).verdict)
            Recording.from_raw(raw)
        except FgNavError as error:
            is_a_line(error)


def _swallow_bytes(data: bytes, path: Path) -> None:
    """Read them as what they are, and as some of all formats."""
    path.write_bytes(data)
    names = sorted(FORMATS)
    first = zlib.crc32(data) % len(names)
    _swallow(path, None, *(names + names)[first : first + 3])


@pytest.mark.parametrize("kind", SAMPLES)
@settings(RELAXED, max_examples=10)
@given(data=st.data())
def test_damaged(kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    sample, folder = SAMPLES[kind], tmp_path_factory.mktemp("broken")
    path = sample.write(SHORT, folder)
    place = data.draw(st.sampled_from(files_of(path)))
    whole = place.read_bytes()
    broken = damage(whole)
    if whole and b"\0" not in whole:
        text = whole.decode()
        broken = st.one_of(broken, scrambled(text, max("\t;,", key=text.count)))
    place.write_bytes(data.draw(broken) if whole else b"\0")
    _swallow(path, sample.sensor, sample.format)
    shutil.rmtree(folder)


@RELAXED
@given(data=st.data())
def test_damaged_truth(data: st.DataObject, tmp_path: Path) -> None:
    write_tum(tmp_path / "truth.tum", SHORT.t, SHORT.acc, np.tile(np.eye(3), (len(SHORT.t), 1, 1)))
    tum = (tmp_path / "truth.tum").read_text()
    whole = data.draw(st.sampled_from([tum, "stride,x_m,y_m\n0,0,0\n1,1.5,2\n2,3,4\n"]))
    _swallow_bytes(data.draw(st.one_of(damage(whole.encode()), scrambled(whole))), tmp_path / "walk.csv")


@RELAXED
@given(data=st.one_of(st.binary(max_size=600), st.text(max_size=300).map(str.encode)))
def test_anything(data: bytes, tmp_path: Path) -> None:
    _swallow_bytes(data, tmp_path / "walk.csv")


@RELAXED
@given(kind=st.sampled_from(list(SAMPLES)), tail=st.binary(max_size=600))
def test_anything_that_begins_like_a_known_file(
    kind: str, tail: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("begins")
    begins = files_of(SAMPLES[kind].write(SHORT, folder))[0].read_bytes()[:140]
    _swallow_bytes(begins + tail, folder / "other.csv")
    shutil.rmtree(folder)
