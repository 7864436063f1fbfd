"""The verbs of the laboratory, and what each is asked (`fg_nav.commands.requests`): simulated walks, campaigns, papers.

`simulate` and `demo` stand beside the other verbs, all but `demo` under `fg-nav lab`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Literal

import typer

from fg_nav.commands.requests import (
    METHOD,
    OUTPUT,
    WALK,
    FolderOptions,
    PlotOptions,
    ReadingOptions,
    RecordingPath,
    Request,
    ViewHost,
    ViewPage,
    ViewPort,
    complete_by,
    option,
)

SEED = "Draws person, sensor, walk, field and noise."


@dataclass(frozen=True, kw_only=True)
class SimulateRequest(FolderOptions, Request):
    """Simulate a walk with its truth: recording.csv, truth.tum, truth.json, landmarks.csv, map.png."""

    verb = "fg_nav.lab.verbs.simulate:simulate"

    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            show_default=False,
            help="Its name, or a .toml file with one.",
            autocompletion=complete_by(lambda: import_module("fg_nav.lab.simulation.scenarios").SCENARIOS),
        ),
    ] = None
    seed: Annotated[int, option(WALK, SEED, min=0)] = 1
    list_all: Annotated[bool, option(WALK, "Say what there is to choose from.", name="--list")] = False
    sensor: Annotated[str | None, option(WALK, "Another sensor.", "NAME")] = None
    field: Annotated[str | None, option(WALK, "Another field.", "NAME")] = None
    site: Annotated[str | None, option(WALK, "Another site, or latitude,longitude,YYYY-MM-DD.", "NAME")] = None
    worn: Annotated[Literal["heel", "instep", "pocket", "table"] | None, option(WALK, "Where it is worn.")] = None
    rate: Annotated[float | None, option(WALK, "Another rate of the recording.", "HZ")] = None
    turn: Annotated[float, option(WALK, "Turn the whole course clockwise.", "DEG")] = 0.0
    calibrated: Annotated[
        bool, option(WALK, "A perfectly calibrated magnetometer: only noise is left.", name="--calibrated")
    ] = False
    rests: Annotated[
        Literal["still", "rocking", "none"] | None,
        option(WALK, "What the foot does where the person stands; none: there is no standing."),
    ] = None
    feet: Annotated[
        Literal["still", "moving"] | None, option(WALK, "Whether the loaded foot moves on, as real ones do.")
    ] = None
    both_feet: Annotated[
        bool,
        option(WALK, "A sensor on each foot: left.csv and right.csv with their truths.", name="--both-feet"),
    ] = False


@dataclass(frozen=True, kw_only=True)
class DemoRequest(PlotOptions, FolderOptions, Request):
    """Simulate four minutes of walking and compare the methods on them; with --view show them as they are walked."""

    verb = "fg_nav.lab.verbs.simulate:demo"

    seed: Annotated[int, option(WALK, SEED, min=0)] = 1
    view: ViewPage = False
    speed: Annotated[float, option(OUTPUT, "Of the walk that is shown; 1 is its own.", "FACTOR")] = 1.0
    host: ViewHost = "127.0.0.1"
    port: ViewPort = 8642


@dataclass(frozen=True, kw_only=True)
class CampaignRequest(Request):
    """Try methods on many walks, simulated and recorded; the same command goes on with what was stopped."""

    verb = "fg_nav.lab.verbs.experiments:campaign"

    plan: Annotated[Path, typer.Argument(metavar="FILE.toml", show_default=False, help="What is to be made.")]
    out: Annotated[
        Path | None, option(OUTPUT, "Folder of the campaign. \\[default: results/ and the file's name]", "DIR")
    ] = None
    scheduler: Annotated[
        str | None,
        option(
            METHOD,
            "Of a Dask cluster, which runs code for all who reach it. \\[default: one of our own]",
            "tcp://HOST:PORT",
        ),
    ] = None
    workers: Annotated[int | None, option(METHOD, "Processes of our own. \\[default: one a core]", "N", min=1)] = None
    renew: Annotated[bool, option(METHOD, "Make again what other code made.", name="--renew")] = False
    retry: Annotated[bool, option(METHOD, "Make again what failed.", name="--retry")] = False


@dataclass(frozen=True, kw_only=True)
class ReproduceRequest(Request):
    """Lay the experiments of a paper beside ours, from simulated walks: report.html, results.json, pictures.

    A run that was ended goes on from there with the same command.
    """

    verb = "fg_nav.lab.verbs.experiments:reproduce"

    paper: Annotated[
        Literal["ma2018", "aiez2017", "munoz-diaz2017"], typer.Argument(show_default=False, help="Its short name.")
    ]
    quick: Annotated[bool, option(METHOD, "3 seeds, and only what takes minutes.", name="--quick")] = False
    seeds: Annotated[int | None, option(METHOD, "Walks of each kind. \\[default: 50, quick 3]", "N", min=1)] = None
    first: Annotated[int, option(METHOD, "Seed of the first walk.", "SEED", min=0)] = 101
    workers: Annotated[int | None, option(METHOD, "Processes. \\[default: one a core]", "N", min=1)] = None
    out: Annotated[
        Path | None, option(OUTPUT, "Folder for the result. \\[default: results/reproduce-PAPER]", "DIR")
    ] = None
    force: Annotated[bool, option(OUTPUT, "Replace an older result in the folder.", name="--force")] = False


@dataclass(frozen=True, kw_only=True)
class AllanRequest(ReadingOptions, FolderOptions, Request):
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""

    verb = "fg_nav.lab.verbs.allan:allan"

    recording: RecordingPath


BESIDE: tuple[type[Request], ...] = (SimulateRequest, DemoRequest)
"""Verbs that stand beside those of a walk, in the order of the help."""

BELOW: tuple[type[Request], ...] = (SimulateRequest, CampaignRequest, ReproduceRequest, AllanRequest)
"""Verbs below `fg-nav lab`."""
