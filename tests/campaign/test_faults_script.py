"""The script that does harm to a campaign: its plan can be, and a table that differs is seen."""

import importlib
import sys
from pathlib import Path

import pytest

from fg_nav.campaign.command import CELLS
from fg_nav.campaign.plan import read_plan
from fg_nav.campaign.table import RESULTS, RESULTS_CSV

SCRIPTS = Path(__file__).parents[2] / "scripts"
sys.path.insert(0, str(SCRIPTS))
script = importlib.import_module("campaign_faults")


@pytest.mark.parametrize("disturbed", ["as the others", "otherwise"])
def test_tables_that_differ_are_told(tmp_path, capsys, monkeypatch, disturbed):
    def campaign(plan, out, *more):
        (out / CELLS).mkdir(parents=True)
        for name in (RESULTS, RESULTS_CSV):
            (out / name).write_text("as the others")

    def harmed(plan, out):
        campaign(plan, out)
        (out / RESULTS).write_text(disturbed)
        return ["worker 1 of 2 killed"]

    monkeypatch.setattr(script, "campaign", campaign)
    monkeypatch.setattr(script, "disturbed", harmed)
    script.main(["--out", str(tmp_path / "out")])
    plan = read_plan(tmp_path / "out" / "plan.toml")
    assert (len(plan.scenarios), len(plan.methods), len(plan.seeds)) == (2, 3, 8)
    printed = capsys.readouterr().out
    assert "worker 1 of 2 killed" in printed
    [row] = [line for line in printed.splitlines() if line.startswith("differing tables, disturbed")]
    assert row.split()[-2:] == (["0", "ok"] if disturbed == "as the others" else ["1", "short"])
