"""Formats and detectors of another package: found by entry points, and as good as those known here."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fg_nav.commands.requests import complete_formats
from fg_nav.errors import FormatError, MagneticError
from fg_nav.io import FORMATS, read_raw
from fg_nav.io.formats import list_formats
from fg_nav.lab.field_survey import parse_detectors
from fg_nav.magnetic.detectors import choose_gate, count_needed, find_gate
from fg_nav.plugins import find_plugins
from tests.io.samples import tilting

EXAMPLE = Path(__file__).parent / "plugins" / "example"
RAW = tilting(np.random.default_rng(1))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example as if it were installed."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    find_plugins.cache_clear()
    yield
    find_plugins.cache_clear()


def write_example(path: Path) -> Path:
    rows = np.column_stack([RAW.t, RAW.acc, RAW.gyr])
    path.write_text("\n".join(["example log", *("|".join(float(v).hex() for v in row) for row in rows)]) + "\n")
    return path


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("format", [None, "example"])
def test_a_format_of_another_package_is_recognized_and_chosen(format: str | None, tmp_path: Path) -> None:
    raw = read_raw(write_example(tmp_path / "walk.log"), format)
    assert raw.provenance.format == "example"
    np.testing.assert_array_equal(raw.acc, RAW.acc)
    np.testing.assert_array_equal(raw.gyr, RAW.gyr)


@pytest.mark.usefixtures("installed")
def test_a_format_of_another_package_stands_in_listings() -> None:
    assert list(list_formats()) == [*FORMATS, "example"]
    assert complete_formats("exam") == ["example"]
    with pytest.raises(FormatError, match=r"choose one of canonical.*, tables, example\.$"):
        read_raw("walk.csv", "nonsense")


def test_without_the_package_its_names_are_unknown(tmp_path: Path) -> None:
    path = write_example(tmp_path / "walk.log")
    with pytest.raises(FormatError, match=f"none of the {len(FORMATS)} formats"):
        read_raw(path)
    with pytest.raises(FormatError, match="there is no format 'example'"):
        read_raw(path, "example")
    with pytest.raises(MagneticError, match="there is no gate 'strict'"):
        choose_gate("strict")


@pytest.mark.usefixtures("installed")
def test_a_detector_of_another_package_is_a_gate() -> None:
    assert choose_gate("strict") == "strict"
    assert choose_gate("strict:hard") == "strict:hard"
    assert find_gate("strict:hard").channels[0].sigma == 0.1
    assert count_needed("strict") == find_gate("strict").max_strides + 1
    assert parse_detectors("strict,qsf") == ["strict", "qsf"]
    with pytest.raises(MagneticError, match=r"no gate 'lax': choose one of qsf.*, strict\.$"):
        choose_gate("lax")
