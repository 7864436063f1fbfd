"""Verbs for simulated walks: simulate, campaign, reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from fg_nav.cli import options as given
from fg_nav.cli.options import answering

verbs = typer.Typer()


@verbs.command()
def simulate(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            show_default=False,
            help="Its name, or a .toml file with one.",
            autocompletion=given.complete_scenarios,
        ),
    ] = None,
    seed: given.Seed = 1,
    list_all: Annotated[bool, typer.Option("--list", help="Say what there is to choose from.")] = False,
    sensor: Annotated[str | None, typer.Option(metavar="NAME", help="Another sensor.")] = None,
    field: Annotated[str | None, typer.Option(metavar="NAME", help="Another field.")] = None,
    site: Annotated[
        str | None, typer.Option(metavar="NAME", help="Another site, or latitude,longitude,YYYY-MM-DD.")
    ] = None,
    worn: Annotated[
        Literal["heel", "instep", "pocket", "table"] | None, typer.Option(help="Another place to wear it.")
    ] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Another rate of the recording.")] = None,
    turn: Annotated[float, typer.Option(metavar="DEG", help="Turn the whole course clockwise.")] = 0.0,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="A perfectly calibrated magnetometer: only noise is left.")
    ] = False,
    rests: Annotated[
        Literal["still", "rocking", "none"] | None,
        typer.Option(help="What the foot does where the person stands; none: there is no standing."),
    ] = None,
    feet: given.FeetWord = None,
    both_feet: Annotated[
        bool, typer.Option("--both-feet", help="A sensor on each foot: left.csv and right.csv with their truths.")
    ] = False,
    out: given.OutDir = None, force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Simulate a walk with its truth: recording.csv, truth.tum, truth.json, landmarks.csv, map.png."""
    from fg_nav.commands.simulate import list_scenarios, simulate
    from fg_nav.lab.simulation import Choices

    choices = Choices(sensor, site, field, worn, rate, turn, calibrated, rests=rests, feet=feet)
    with answering(json, quiet) as answer:
        if list_all:
            answer(list_scenarios())
        elif scenario is None:
            raise typer.BadParameter("name one, or a file; --list says what there is.", param_hint="SCENARIO")
        else:
            answer(simulate(scenario, seed, choices, both_feet, out, force))


@verbs.command()
def campaign(
    plan: Annotated[Path, typer.Argument(metavar="FILE.toml", show_default=False, help="What is to be made.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder of the campaign. \\[default: results/ and the file's name]"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Of a Dask cluster, which runs code for all who reach it. \\[default: one of our own]",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes of our own. \\[default: one a core]")
    ] = None,
    renew: Annotated[bool, typer.Option("--renew", help="Make again what other code made.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Make again what failed.")] = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Try methods on many walks, simulated and recorded; the same command goes on with what was stopped."""
    from fg_nav.commands import RESULTS
    from fg_nav.commands.campaign import campaign
    from fg_nav.lab.campaign.command import Request

    with answering(json, quiet) as answer:
        answer(campaign(Request(plan, out or RESULTS / plan.stem, scheduler, workers, renew, retry)))


@verbs.command()
def reproduce(
    paper: Annotated[
        Literal["ma2018", "aiez2017", "munoz-diaz2017"], typer.Argument(show_default=False, help="Its short name.")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="3 seeds, and only what takes minutes.")] = False,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="How many walks of each kind. \\[default: 50, quick 3]")
    ] = None,
    first: Annotated[int, typer.Option(metavar="SEED", min=0, help="Seed of the first walk.")] = 101,
    workers: Annotated[int | None, typer.Option(metavar="N", min=1, help="Processes. \\[default: one a core]")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the result. \\[default: results/reproduce-PAPER]"),
    ] = None,
    force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Lay the experiments of a paper beside ours, from simulated walks: report.html, results.json, pictures.

    A run that was ended goes on from there with the same command.
    """
    from fg_nav.commands import RESULTS, Answer
    from fg_nav.lab.reproduce.command import print_rows, reproduce
    from fg_nav.lab.reproduce.results import describe_reproduction

    place = out or RESULTS / f"reproduce-{paper}"
    with answering(json, quiet) as answer:
        found = reproduce(paper, place, seeds, first, workers, quick, force)
        answer(Answer({"folder": str(place), **describe_reproduction(found)}, lambda: print_rows(found, place)))
