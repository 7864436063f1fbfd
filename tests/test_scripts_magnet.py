"""The script of AIEZ Figure 6."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"
sys.path.insert(0, str(SCRIPTS))
magnet_corridor = importlib.import_module("magnet_corridor")


def walk(**statistic):
    turned = np.array([0.5, 1.0, 15.0, 30.0])
    return magnet_corridor.Judged(turned, {name: np.array(of, dtype=float) for name, of in statistic.items()})


def test_shares_are_of_those_that_were_judged_in_their_zone():
    walks = [walk(aiez=[0.5, np.nan, 3, 3]), walk(aiez=[3, 0.9, 0.1, 1.1])]
    assert magnet_corridor.share(walks, "aiez", 0.0, 2.0) == "67% (50%-100%)"
    assert magnet_corridor.share(walks, "aiez", 10.0, 20.0) == "50% (0%-100%)"
    assert magnet_corridor.share(walks, "aiez", 45.0, 180.0) == "-"


@pytest.mark.parametrize(("near", "marks"), [(5.0, ["ok", "ok", "ok", "ok"]), (0.5, ["ok", "short", "ok", "ok"])])
def test_aiez_that_accepts_what_is_near_is_short(near, marks):
    still = {name: [0.2, 0.3, 0.25, 0.3] for name in magnet_corridor.DETECTORS}
    walks = [walk(**{**still, "aiez": [0.2, 0.2, near, near]})]
    assert [f.mark for f in magnet_corridor.figures_of("magnet", walks)][:4] == marks
    assert magnet_corridor.told_apart(walks, "aiez") == 1.0
    assert magnet_corridor.told_apart(walks, "qsf-stance") == (1.0 + 1.5) / 4.0  # one above one far; above one, tied
    assert magnet_corridor.told_apart([walk(aiez=[0.2, 0.2, np.nan, np.nan])], "aiez") == np.inf


def test_what_no_footfall_shows_is_short():
    nowhere = [walk(**{name: [np.nan] * 4 for name in magnet_corridor.DETECTORS})]
    assert [f.mark for f in magnet_corridor.figures_of("magnet", nowhere)][:4] == ["short"] * 4


def test_figure_6_on_two_walks(tmp_path, capsys):
    path = tmp_path / "figures.json"
    magnet_corridor.main(["--seeds", "2", "--json", str(path)])
    printed = capsys.readouterr().out
    assert "magnet 10 x, magnetometer calibrated" in printed
    strong = [f for f in json.loads(path.read_text())["figures"] if f["section"].startswith("magnet 10 x")]
    assert [f["mark"] for f in strong[:4]] == ["ok"] * 4
