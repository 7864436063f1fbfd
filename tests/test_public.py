"""The names of the package and the examples: what they say of themselves, and that what they show there is so."""

import doctest
import importlib.util
import inspect
import re
import runpy
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import fg_nav
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import simulate, simulate_feet
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth

ROOT = Path(__file__).parents[1]
NAMES = {"fg_nav": fg_nav, "np": np, "pd": pd, "Recording": Recording}  # What an example finds there.


@cache
def twenty_seconds() -> Recording:
    """Seventeen footfalls with a field and a truth, of the scenario `demo`."""
    return simulate("demo", 1).recording.slice(0, 4000)


@cache
def both_feet() -> dict[str, Recording]:
    """The same of both feet."""
    return {side: one.recording.slice(0, 4000) for side, one in simulate_feet("demo", 1).sides.items()}


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Recording:
    """A working directory with `walk.csv`, `truth.tum`, `left.csv`, `right.csv`; a method runs once on a file."""
    recording = twenty_seconds()
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_canonical(recording, tmp_path / "walk.csv")
    write_tum(tmp_path / "truth.tum", truth.t, truth.position, truth.nav_R_body)
    for side, foot in both_feet().items():
        write_canonical(foot, tmp_path / f"{side}.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(mpl.rcParams, "backend", "agg")
    for name in ("navigate", "navigate_feet"):
        monkeypatch.setattr(fg_nav, name, once(getattr(fg_nav, name)), raising=False)
    return recording


def once(navigate: Callable[..., Any]) -> Callable[..., Any]:
    """Do the same thing once only."""
    done: dict[str, Any] = {}

    @wraps(navigate)
    def remember(*given: object, **named: object) -> Any:
        key = repr((given, named))
        if key not in done:
            done[key] = navigate(*given, **named)
        return done[key]

    return remember


def test_every_public_name_shows_an_example() -> None:
    assert dir(fg_nav) == sorted(fg_nav.__all__)
    assert not [name for name in dir(fg_nav) if importlib.util.find_spec(f"fg_nav.{name}")]  # would stand in its place
    assert [name for name in dir(fg_nav) if ">>> " not in (inspect.getdoc(getattr(fg_nav, name)) or "")] == []


def test_examples_are_true(walk: Recording) -> None:
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner(verbose=False)  # else as `pytest -v` is
    said: list[str] = []
    for name in dir(fg_nav):
        for example in finder.find(getattr(fg_nav, name), name, globs=NAMES):
            runner.run(example, out=said.append)
    assert "".join(said) == ""
    assert runner.summarize(verbose=False).attempted > 30


def test_the_page_on_python_is_true(walk: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    whole = simulate("demo", 1).recording
    samples = np.column_stack([1e3 * whole.t, whole.acc / GRAVITY_M_S2, np.degrees(whole.gyr)])
    pd.DataFrame(samples, columns=["t", "ax", "ay", "az", "gx", "gy", "gz"]).to_csv("shoe.csv", index=False)
    names: dict[str, Any] = {}
    for code in re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(encoding="utf-8"), re.DOTALL):
        exec(code, names)
        if "end_at_start" in code:
            end = names["result"].stances
            assert np.abs(end.position[-1]).max() < 0.2
            assert end.position_sigma[-1].max() < 0.11
    assert Path("back.png").stat().st_size > 10_000
    assert Path("steps.csv").read_text().count("\n") == len(names["solution"].stances) + 1
    assert np.abs(names["walk"].solution.stances.position[-1, 2]) < 0.02
    assert len(walk) == len(names["solution"].t)
    assert "(6, 6)" in capsys.readouterr().out


def test_the_example_of_the_readme_runs(walk: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    exec(code, {})
    assert "strides_detected" in capsys.readouterr().out


def test_a_solution_alone_is_saved_and_drawn(walk: Recording) -> None:
    solution = fg_nav.run_iez(walk, fg_nav.detect_stances(walk))
    assert {"trajectory.tum", "strides.csv", "summary.json"} <= {file.name for file in solution.save("mine").iterdir()}
    with pytest.raises(fg_nav.FgNavError, match=r"choose another path, or replace it with force=True\.$"):
        solution.save("mine")
    with pytest.raises(fg_nav.FgNavError, match=r"nothing is written as '\.xyz'"):
        solution.save("mine.xyz")
    with pytest.raises(fg_nav.FgNavError, match="iez makes no use of extra factors"):
        fg_nav.navigate(walk, "iez", extra=lambda _: None)
    axes = solution.plot()
    assert solution.plot(axes) is axes
    np.testing.assert_array_equal(solution.to_dataframe()[["x_m", "y_m", "z_m"]].to_numpy(), solution.position)
    assert repr(solution).startswith("<Solution by iez: 4000 samples, 17 footfalls")


def test_two_feet_are_saved_and_drawn(walk: Recording) -> None:
    result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial")
    assert result.left is not None
    assert result.right is not None
    files = {file.name for file in result.save("both").iterdir()}
    assert {"trajectory.tum", "trajectory_left.tum", "person.csv", "summary.json", "report.html"} <= files
    assert result.save("both.geojson", origin=(48.0, 11.0)).stat().st_size > 0
    assert result.plot().get_xlabel() == "x (m)"
    assert len(result.to_dataframe("footfalls")) == len(result.stances)


def test_what_is_printed_is_a_line_and_a_notebook_shows_a_table(walk: Recording) -> None:
    result = fg_nav.navigate(walk)
    smoothed = fg_nav.smooth_graph(walk, result.walk.stances, heading=None, field=result.walk.field)
    parts = (*vars(result).values(), *vars(result.walk).values(), smoothed, *vars(smoothed).values(), smoothed.nodes)
    ours = [one for one in (*parts, simulate("demo", 1)) if type(one).__module__.startswith("fg_nav")]
    assert len(ours) > 10
    assert [type(one) for one in ours if len(repr(one)) > 800 or "\n" in repr(one)] == []
    assert repr(result.walk.stances).startswith("Stances(start=int64(17,), stop=int64(17,), ")
    # every factor of the graph has its kind, of which the summary counts the same, and its name
    table = smoothed.factors
    assert table.error.sum() == pytest.approx(smoothed.graph.error(smoothed.values))
    assert dict(table.kind.value_counts()) == {"": (table.kind == "").sum()} | {
        kind: count for kind, count in smoothed.solution.graph.items() if count
    }
    assert {"stance velocity", "magnetic heading", "GalileanImuFactor", "zero rate"} <= set(table.name)
    # in a notebook
    for one, words in ((walk, "4000 samples over"), (result, "<th>distance</th>"), (smoothed.solution, "<svg ")):
        html = one._repr_html_()
        assert words in html
        assert len(html) < 20_000
    corners = re.findall(r'points="([^"]+)"', result._repr_html_())[-1].split()
    drawn = np.array([corner.split(",") for corner in corners], dtype=float)
    seen, walked = np.ptp(drawn, axis=0), np.ptp(result.outcome.comparison.estimate[:, :2], axis=0)
    np.testing.assert_allclose(seen / seen.max(), walked / walked.max(), atol=0.01)  # to scale


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
