"""The scripts that make a paper's experiments from a checkout: what they print."""

import importlib
import sys
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.reproduce.results import Experiment, Reproduction, Row, Spread

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))


def made(folder, seeds, workers, progress, quick):
    """One experiment with a row of each kind."""
    progress(1.0)
    ours = {"as printed": Spread(0.8, 0.5, 1.2, len(seeds)), "tuned": Spread(0.4, 0.4, 0.4, 1)}
    rows = [
        Row("final position error", "m", "<= 0.5", ours, 0.5, "as printed", bound=1, why="the field is rough."),
        Row("largest error", "m", "", ours),
        Row("mean error", "m", "0.1", ours, 0.1, "tuned"),
    ]
    experiment = Experiment("M-E3", f"office, quick {quick}", "", ("as printed", "tuned"), rows)
    return Reproduction("a paper", "", "", tuple(seeds), [experiment])


@pytest.mark.parametrize("name", ["ma2018", "aiez2017"])
def test_rows_and_reasons_are_printed(name, tmp_path, capsys, monkeypatch):
    script = importlib.import_module(f"reproduce_{name}")
    monkeypatch.setattr(script, "reproduce", made)
    script.main(["--out", str(tmp_path), "--seeds", "4", "--quick"])
    printed = capsys.readouterr().out
    assert "M-E3: office, quick True" in printed
    row = next(line for line in printed.splitlines() if line.startswith("final position error"))
    assert row.split()[4:] == ["<=", "0.5", "0.80", "(0.50", "to", "1.20)", "0.40", "explained"]
    assert "explained: final position error. the field is rough." in printed
    assert "not reproduced: mean error." in printed
    with pytest.raises(OutputError, match="make it"):
        script.main(["--out", str(tmp_path / "nowhere")])
