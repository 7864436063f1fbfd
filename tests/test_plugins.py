"""A package of somebody else adds to this one by its entry points (`tests/plugins/example`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "tests" / "plugins" / "example"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plugins") / "walk.csv"
    write_canonical(simulate("demo", 1).recording.slice(0, 2000), file)
    return file


def fg_nav(*arguments: str | Path, path: Path = EXAMPLE) -> subprocess.CompletedProcess[str]:
    """Run fg-nav where this package is installed too."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(path)))}
    command = [sys.executable, "-m", "fg_nav.cli", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_method_of_another_package_is_run_by_its_name(tmp_path: Path, walk: Path) -> None:
    out = tmp_path / "out"
    done = fg_nav("run", walk, "--method", "standing", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["method"], summary["distance_m"]) == ("standing", 0.0)
    again = fg_nav("run", walk, "--config", out / "config.json", "--out", tmp_path / "again", "--json")
    assert json.loads(again.stdout)["method"] == "standing", again.stderr


def test_a_method_of_another_package_is_listed_and_refuses_what_it_does_not_use(walk: Path) -> None:
    unknown = fg_nav("run", walk, "--method", "standin")
    assert unknown.returncode == 1
    assert "standing" in unknown.stderr
    refused = fg_nav("run", walk, "--method", "standing", "--polish")
    assert "standing makes no use of --polish" in refused.stderr
    assert fg_nav("run", walk, "--method", "standing", path=ROOT).returncode == 1
