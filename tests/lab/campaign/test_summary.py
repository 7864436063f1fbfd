"""What a campaign tells at its end."""

from dataclasses import replace
from pathlib import Path

from fg_nav.lab.campaign.command import Summary
from fg_nav.lab.campaign.dispatch import KILLED
from fg_nav.lab.verbs.experiments import print_campaign
from tests.lab.campaign import fakes


def told(capsys, *reasons):
    results = fakes.results(fakes.task("demo", "101", *(f"iez,k={k}" for k in range(len(reasons)))))
    failed = tuple(replace(one, failed=reason) for one, reason in zip(results, reasons, strict=True))
    print_campaign(Summary(failed, 0), Path("out"))
    return capsys.readouterr().out


def test_a_failure_names_its_cell_and_what_to_do(capsys):
    out = told(capsys, "no stance.")
    assert "failed: demo, smooth, 101, loop, iez,k=0: no stance." in out
    assert "1 result failed: --retry makes them again\n" in out


def test_where_memory_ran_out_fewer_workers_are_proposed(capsys):
    assert "2 results failed: --retry makes them again, with fewer --workers" in told(capsys, "no stance.", KILLED)


def test_only_some_reasons_are_told(capsys):
    out = told(capsys, *[KILLED] * 12)
    assert out.count("failed: demo") == 10
    assert "and 2 more failed" in out
    assert "12 results failed: --retry" in out
