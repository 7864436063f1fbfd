"""The examples of the documentation run, those that take seconds; the others run where the site is built."""

import runpy
from functools import cache
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

import fg_nav
from tests.test_public import once

EXAMPLES = {path.stem: path for path in sorted((Path(__file__).parents[1] / "docs/examples").glob("*.py"))}
WITH_THE_SITE = ("06_live", "07_pocket", "09_pyshoe")
"""Half a minute of compiling, a second layer of the online smoother, recordings of others."""

SAID = {
    "01_first_walk": "verdict: trusted",
    "02_own_arrays": "left out 1 missing sample, the first in row 4001",
    "03_own_factor": "tied     sigma",
    "04_calibrate_magnetometer": "hard iron (uT)",
    "05_ros_bag": "ros 4000 samples",
    "08_compare_with_filter": "iez      rmse",
    "10_own_graph": "batch    ends 0.",
}


@pytest.fixture(scope="module")
def shared() -> dict[str, object]:
    """Walks that are simulated, and solved, once for all examples."""
    return {"simulate": cache(fg_nav.simulate), "navigate": once(fg_nav.navigate)}


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in WITH_THE_SITE])
def test_examples_run(
    name: str, shared: dict[str, object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if "ros" in name:
        pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    for public, function in shared.items():
        monkeypatch.setattr(fg_nav, public, function, raising=False)
    monkeypatch.setitem(mpl.rcParams, "backend", "agg")
    runpy.run_path(str(EXAMPLES[name]))
    plt.close("all")
    assert SAID[name] in capsys.readouterr().out
    longest = 60 if name == "10_own_graph" else 40
    assert len(EXAMPLES[name].read_text(encoding="utf-8").splitlines()) <= longest
