"""Every format reads its sample in SI, is recognized as itself and by no other, and refuses a damaged one."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.errors import FgNavError, FormatError
from fg_nav.io import FORMATS, read_raw
from fg_nav.io.content import read_content
from fg_nav.recording import Recording
from tests.io.every_format import SAMPLES
from tests.io.foreign_phones import expected_force
from tests.io.samples import tilting
from tests.io.test_broken_files import RELAXED, damage, is_a_line, scrambled

RAW = tilting(np.random.default_rng(3), duration_s=4.0, rate_hz=100.0, still_s=1.0)
SHORT = tilting(np.random.default_rng(5), duration_s=0.4, rate_hz=100.0, still_s=0.1)
FEW = settings(RELAXED, max_examples=6)

ANY_TABLE = {"xio", "table", "tables"}  # Tried after the others: they are recognized by names that others have too.


def find_rows(recording: Recording) -> np.ndarray:
    """Rows of `RAW` that the samples are: they begin where the first rates are most alike."""
    apart = [np.abs(RAW.gyr[k : k + 5] - recording.gyr[:5]).sum() for k in range(30)]
    return int(np.argmin(apart)) + np.rint((recording.t - recording.t[0]) * 100).astype(int)


def files_of(path: Path) -> list[Path]:
    return sorted(place for place in path.rglob("*") if place.is_file()) if path.is_dir() else [path]


def test_every_format_has_a_sample() -> None:
    assert {sample.format for sample in SAMPLES.values()} | {"ros", "tables"} == set(FORMATS)


@pytest.mark.parametrize("kind", SAMPLES)
def test_it_is_recognized_as_itself_and_read_in_si(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    content = read_content(path)
    found = [name for name, one in FORMATS.items() if content.kind in one.kinds and one.recognizes(content)]
    assert found[0] == sample.format
    assert set(found) <= {sample.format, *ANY_TABLE}
    raw = read_raw(path, sensor=sample.sensor)
    assert raw.provenance.format == sample.format
    assert raw.provenance.path == path
    recording = Recording.from_raw(raw)
    k = find_rows(recording)
    assert len(k) >= 0.99 * len(RAW.t) - 3
    np.testing.assert_allclose(recording.t - recording.t[0], RAW.t[k] - RAW.t[k[0]], atol=2e-3)
    np.testing.assert_allclose(recording.gyr, RAW.gyr[k], atol=sample.digits)
    force = expected_force(RAW, RAW.t[k]) if sample.late else RAW.acc[k]
    np.testing.assert_allclose(recording.acc, force, atol=max(sample.digits, 1e-6))
    assert RAW.mag is not None
    if recording.mag is not None:
        sampled = np.isfinite(recording.mag).all(axis=1)
        assert sampled.mean() > 0.2
        np.testing.assert_allclose(recording.mag[sampled], RAW.mag[k][sampled], atol=max(1e-4, 100 * sample.digits))


@pytest.mark.parametrize("kind", SAMPLES)
def test_its_rows_are_those_of_the_file(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    raw = read_raw(path, sensor=sample.sensor)
    assert raw.row.shape == raw.t.shape
    assert (np.diff(raw.row) > 0).all()
    lines = [place.read_bytes().count(b"\n") for place in files_of(path)]
    assert 1 <= raw.row[0] <= 12
    assert raw.row[-1] <= max(*lines, len(RAW.t))


@pytest.mark.parametrize("kind", SAMPLES)
@FEW
@given(data=st.data())
def test_damaged(kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A file of a recording is damaged; what comes of it is a recording, or one sentence."""
    sample, folder = SAMPLES[kind], tmp_path_factory.mktemp("broken")
    path = sample.write(SHORT, folder)
    place = data.draw(st.sampled_from(files_of(path)))
    whole = place.read_bytes()
    broken = damage(whole)
    if whole and b"\0" not in whole:
        text = whole.decode()
        broken = st.one_of(broken, scrambled(text, max("\t;,", key=text.count)))
    place.write_bytes(data.draw(broken) if whole else b"\0")
    for name in (None, sample.format):
        try:
            Recording.from_raw(read_raw(path, name, sensor=sample.sensor))
        except FgNavError as error:
            is_a_line(error)
    shutil.rmtree(folder)


@pytest.mark.parametrize("kind", SAMPLES)
def test_one_that_is_cut_within_its_beginning_is_refused(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    for place in files_of(path):
        place.write_bytes(place.read_bytes()[:60])
    with pytest.raises(FormatError) as caught:
        read_raw(path, sample.format, sensor=sample.sensor)
    is_a_line(caught.value)
    assert ": " in str(caught.value)
