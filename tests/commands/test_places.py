"""`--save-places` and `--places`: a later walk is located on the places of an earlier one, or said not to be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.io import read, write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.places import read_places
from fg_nav.recording import Recording
from tests.command_line import FgNav
from tests.commands.folders import strides, summary

NO_PLOTS = ("--plots", "none")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `first.csv`, `part.csv`, which is its end from the tenth footfall on, and `other.csv`."""
    folder = tmp_path_factory.mktemp("recordings")
    first, other = (simulate("demo", seed).recording for seed in (5, 6))
    write_canonical(first, folder / "first.csv")
    write_canonical(begin_later(first, 10), folder / "part.csv")
    write_canonical(other, folder / "other.csv")
    return folder


def begin_later(recording: Recording, footfall: int) -> Recording:
    """The walk from a footfall on, with more noise."""
    stances = detect_stances(recording)
    part = recording.slice(int(stances.start[footfall]), len(recording))
    assert part.mag is not None
    return replace(part, mag=part.mag + np.random.default_rng(1).normal(0.0, 0.3, part.mag.shape), truth=None)


@pytest.fixture
def saved(fg_nav: FgNav, files: Path) -> Path:
    """Places of the first walk, whose result is beside them; made once."""
    place = files / "office.places"
    if not place.exists():
        words = ("--save-places", place, "--plots", "none", "--out", files / "first")
        assert fg_nav("run", files / "first.csv", *words).code == 0
    return place


def test_a_later_walk_is_located_on_saved_places(fg_nav: FgNav, files: Path, saved: Path) -> None:
    assert "located" not in summary(files / "first")
    assert read_places(saved).recording == "first.csv"
    ran = fg_nav(
        "run", files / "part.csv", "--places", saved, "--out", "part", "--save-places", "part.places", *NO_PLOTS
    )
    assert ran.code == 0, ran.err
    found, path, first = summary("part"), strides("part"), strides(files / "first")
    at, located = first.iloc[(first["time_s"] - path["time_s"][0]).abs().argmin()], found["located"]
    for axis in "xy":
        error = located[f"{axis}_m"] - at[f"{axis}_m"]
        assert abs(error) < min(3.0 * located[f"sigma_{axis}_m"], 1.0)
        assert path[f"{axis}_m"][0] == pytest.approx(located[f"{axis}_m"])
        # the end of both is one place
        assert path[f"{axis}_m"].iloc[-1] == pytest.approx(first[f"{axis}_m"].iloc[-1], abs=1.0)
    turned = (located["heading_deg"] - at["heading_deg"] + 180.0) % 360.0 - 180.0
    assert abs(turned) < 5.0
    assert located["stretches"][0]["known_begin_s"] == pytest.approx(located["stretches"][0]["begin_s"], abs=1.0)
    assert any(note.startswith("on the places of first.csv") for note in found["notes"])
    assert found["graph"]["known_place"] > 3
    assert "note: on the places of first.csv, by " in ran.out
    # in the same frame for the next one
    assert np.linalg.norm(read_places(Path("part.places")).path.position[0] - at[["x_m", "y_m", "z_m"]]) < 1.5
    again = fg_nav("run", files / "part.csv", "--config", "part/config.json", *NO_PLOTS, "--out", "again")
    assert again.code == 0
    assert summary("again")["located"] == located


def test_a_walk_elsewhere_stays_in_its_own_frame_and_says_so(fg_nav: FgNav, files: Path, saved: Path) -> None:
    assert fg_nav("run", files / "other.csv", "--places", saved, *NO_PLOTS, "--out", "other").code == 0
    found = summary("other")
    assert found["located"] is None
    assert any("nothing of the saved places was recognized" in note for note in found["notes"])
    assert strides("other")["x_m"][0] == pytest.approx(0.0, abs=1e-3)


def test_places_are_not_overwritten_without_force(fg_nav: FgNav, files: Path, saved: Path) -> None:
    before, place = saved.read_bytes(), Path("mine.places")
    place.write_bytes(before)
    arguments = ("run", files / "part.csv", "--save-places", place, *NO_PLOTS)
    assert fg_nav(*arguments).refused("mine.places already exists", "--force")
    assert place.read_bytes() == before
    assert fg_nav(*arguments, "--force", "--method", "iez").code == 0
    assert place.read_bytes() != before
    Path("notes").write_text("mine")
    assert fg_nav("run", files / "first.csv", "--save-places", "notes", "--force").refused("does not write")


def test_what_has_no_use_of_places_is_refused(fg_nav: FgNav, files: Path, saved: Path) -> None:
    run = ("run", files / "first.csv", "--places", saved)
    assert fg_nav(*run, "--method", "iez").refused("iez makes no use of saved places")
    Path("fixes.csv").write_text("time_s,x_m,y_m,z_m,sigma_m\n20,1,2,,1\n")
    assert fg_nav(*run, "--fixes", "fixes.csv").refused("give one of them")


def test_the_result_of_a_walk_too_short_for_places_is_written_and_the_reason_told(fg_nav: FgNav, files: Path) -> None:
    first = read(files / "first.csv")
    stances = detect_stances(first)
    write_canonical(first.slice(0, int(stances.stop[6])), Path("short.csv"))
    ran = fg_nav("run", "short.csv", "--save-places", "short.places", "--out", "short", "--quiet")
    assert ran.refused("too short for its places to be saved", "20 m")
    assert summary("short")["strides"]
    assert not Path("short.places").exists()
