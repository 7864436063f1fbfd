"""`--fixes`: known positions from the command line to the smoother and into the record."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.io import write_canonical
from tests.command_line import FgNav
from tests.smoother.walks import demo


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "walk.csv"
    write_canonical(demo().recording, path)
    return path


def fixes(*lines: str) -> str:
    Path("fixes.csv").write_text("\n".join(["time_s,x_m,y_m,z_m,sigma_m", *lines]) + "\n", encoding="utf-8")
    return "fixes.csv"


def test_the_walk_goes_through_its_fixes(fg_nav: FgNav, walk: Path) -> None:
    assert fg_nav("run", walk, "--out", "free").code == 0
    free = pd.read_csv("free/strides.csv")
    row = free.iloc[25]
    place = 1.01 * np.array([-row["y_m"], row["x_m"]])  # a quarter to the left, and a little farther
    told = fixes(f"{row['time_s']},{place[0]},{place[1]},,0.01")
    assert fg_nav("run", walk, "--fixes", told, "--out", "fixed").code == 0
    found = pd.read_csv("fixed/strides.csv").iloc[25]
    np.testing.assert_allclose([found["x_m"], found["y_m"]], place, atol=0.05)
    assert json.loads(Path("fixed/config.json").read_text())["fixes"] == "fixes.csv"
    assert json.loads(Path("free/config.json").read_text())["fixes"] is None


def test_fixes_that_cannot_be_used_are_refused_in_one_line(fg_nav: FgNav, walk: Path) -> None:
    assert fg_nav("run", walk, "--fixes", fixes("10,1,2,,0")).refused("line 2 has no sigma above zero")
    assert fg_nav("run", walk, "--fixes", fixes("1000,1,2,,1")).refused("1000.00 s is outside the walk")
    assert fg_nav("run", walk, "--fixes", "none.csv").refused("none.csv does not exist")
    assert fg_nav("run", walk, "--method", "iez", "--fixes", fixes("10,1,2,,1")).refused("iez makes no use of fixes")
