"""The verbs of the laboratory, and what each is asked (`fg_nav.commands.requests`): simulated walks, campaigns, papers.

`simulate` and `demo` stand beside the other verbs, all but `demo` under `fg-nav lab`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Literal

from fg_nav.commands.requests import (
    METHOD,
    OUTPUT,
    WALK,
    FolderOptions,
    PlotOptions,
    ReadingOptions,
    Request,
    ViewOptions,
    argument,
    complete_by,
    flag,
    option,
)

SEED = "Draws person, sensor, walk, field and noise."


@dataclass(frozen=True, kw_only=True)
class SimulateRequest(FolderOptions, Request):
    """Simulate a walk with its truth: recording.csv, truth.tum, truth.json, landmarks.csv, map.png."""

    verb = "fg_nav.lab.verbs.simulate:simulate"

    scenario: str | None = argument(
        "SCENARIO",
        "Its name, or a .toml file with one.",
        default=None,
        autocompletion=complete_by(lambda: import_module("fg_nav.lab.simulation.scenarios").SCENARIOS),
    )
    seed: int = option(WALK, SEED, default=1, min=0)
    list_all: bool = flag(WALK, "Say what there is to choose from.", name="--list")
    sensor: str | None = option(WALK, "Another sensor.", "NAME")
    field: str | None = option(WALK, "Another field.", "NAME")
    site: str | None = option(WALK, "Another site, or latitude,longitude,YYYY-MM-DD.", "NAME")
    worn: Literal["heel", "instep", "pocket", "table"] | None = option(WALK, "Where it is worn.")
    rate: float | None = option(WALK, "Another rate of the recording.", "HZ")
    turn: float = option(WALK, "Turn the whole course clockwise.", "DEG", default=0.0)
    calibrated: bool = flag(WALK, "A perfectly calibrated magnetometer: only noise is left.", "--calibrated")
    rests: Literal["still", "rocking", "none"] | None = option(
        WALK, "What the foot does where the person stands; none: there is no standing."
    )
    feet: Literal["still", "moving"] | None = option(WALK, "Whether the loaded foot moves on, as real ones do.")
    both_feet: bool = flag(WALK, "A sensor on each foot: left.csv and right.csv with their truths.", "--both-feet")


@dataclass(frozen=True, kw_only=True)
class DemoRequest(ViewOptions, PlotOptions, FolderOptions, Request):
    """Simulate four minutes of walking and compare the methods on them; with --view show them as they are walked."""

    verb = "fg_nav.lab.verbs.simulate:demo"

    seed: int = option(WALK, SEED, default=1, min=0)
    speed: float = option(OUTPUT, "Of the walk that is shown; 1 is its own.", "FACTOR", default=1.0)


@dataclass(frozen=True, kw_only=True)
class CampaignRequest(Request):
    """Try methods on many walks, simulated and recorded; the same command goes on with what was stopped."""

    verb = "fg_nav.lab.verbs.experiments:campaign"

    plan: Path = argument("FILE.toml", "What is to be made.")
    out: Path | None = option(OUTPUT, "Folder of the campaign. \\[default: results/ and the file's name]", "DIR")
    scheduler: str | None = option(
        METHOD,
        "Of a Dask cluster, which runs code for all who reach it. \\[default: one of our own]",
        "tcp://HOST:PORT",
    )
    workers: int | None = option(METHOD, "Processes of our own. \\[default: one a core]", "N", min=1)
    renew: bool = flag(METHOD, "Make again what other code made.", "--renew")
    retry: bool = flag(METHOD, "Make again what failed.", "--retry")


@dataclass(frozen=True, kw_only=True)
class ReproduceRequest(Request):
    """Lay the experiments of a paper beside ours, from simulated walks: report.html, results.json, pictures.

    A run that was ended goes on from there with the same command.
    """

    verb = "fg_nav.lab.verbs.experiments:reproduce"

    paper: Literal["ma2018", "aiez2017", "munoz-diaz2017"] = argument(None, "Its short name.")
    quick: bool = flag(METHOD, "3 seeds, and only what takes minutes.", "--quick")
    seeds: int | None = option(METHOD, "Walks of each kind. \\[default: 50, quick 3]", "N", min=1)
    first: int = option(METHOD, "Seed of the first walk.", "SEED", default=101, min=0)
    workers: int | None = option(METHOD, "Processes. \\[default: one a core]", "N", min=1)
    out: Path | None = option(OUTPUT, "Folder for the result. \\[default: results/reproduce-PAPER]", "DIR")
    force: bool = flag(OUTPUT, "Replace an older result in the folder.", "--force")


@dataclass(frozen=True, kw_only=True)
class AllanRequest(ReadingOptions, FolderOptions, Request):
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""

    verb = "fg_nav.lab.verbs.allan:allan"

    recording: Path = argument("RECORDING", "File with the recording.")


BESIDE: tuple[type[Request], ...] = (SimulateRequest, DemoRequest)
"""Verbs that stand beside those of a walk, in the order of the help."""

BELOW: tuple[type[Request], ...] = (SimulateRequest, CampaignRequest, ReproduceRequest, AllanRequest)
"""Verbs below `fg-nav lab`."""
