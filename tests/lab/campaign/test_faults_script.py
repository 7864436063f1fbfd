"""The script that does harm to a campaign: its plan can be, and a table that differs is seen."""

import contextlib
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.folder import RESULTS, RESULTS_CSV, RESULTS_FOLDER
from fg_nav.lab.campaign.plan import read_plan
from tests.scripts import load_script

script = load_script("campaign_faults")


@pytest.mark.parametrize("disturbed", ["as the others", "otherwise"])
def test_tables_that_differ_are_told(tmp_path, capsys, monkeypatch, disturbed):
    def campaign(plan, out, *more):
        (out / RESULTS_FOLDER).mkdir(parents=True)
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
    assert row.split()[-2:] == (["0", "ok"] if disturbed == "as the others" else ["1", "missed"])


def test_campaigns_that_are_there_would_prove_nothing(tmp_path):
    (tmp_path / "again").mkdir()
    with pytest.raises(CampaignError, match="again is there already"):
        script.main(["--out", str(tmp_path)])


def test_a_campaign_does_not_outlive_a_harm_that_fails(tmp_path, monkeypatch):
    """Such as a worker that is to be killed and is gone already."""
    started = []

    class Cluster:
        address = "tcp://127.0.0.1:1"

        def tend(self):
            raise LookupError("no worker")

        kill_worker = restart_scheduler = tend

    def popen(*words, **more):
        started.append(subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], **more))
        return started[0]

    monkeypatch.setattr(script, "own_cluster", lambda: contextlib.nullcontext(Cluster()))
    own = SimpleNamespace(**{**vars(subprocess), "Popen": popen})
    monkeypatch.setattr(script, "subprocess", own)
    with pytest.raises(LookupError):
        script.disturbed(tmp_path / "plan.toml", tmp_path / "disturbed")
    assert started[0].returncode == -signal.SIGKILL
