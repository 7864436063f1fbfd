"""`--save-places` and `--places`: a later walk is located on the places of an earlier one, or said not to be."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.io import write_canonical
from fg_nav.places import read_places
from tests.command_line import FgNav
from tests.commands.folders import strides, summary
from tests.commands.recordings import recorded, recording

NO_PLOTS = ("--plots", "none")


@pytest.fixture
def saved(fg_nav: FgNav) -> Path:
    """Places of the first walk, whose result is beside them; made once."""
    place = recorded("walk").with_name("office.places")
    if not place.exists():
        words = ("--save-places", place, "--plots", "none", "--out", place.with_name("first"))
        fg_nav("run", recorded("walk"), *words).succeeded()
    return place


def test_a_later_walk_is_located_on_saved_places(fg_nav: FgNav, saved: Path) -> None:
    assert "located" not in summary(saved.with_name("first"))
    assert read_places(saved).recording == "walk.csv"
    places = ("--places", saved, "--save-places", "part.places")
    ran = fg_nav("run", recorded("end"), *places, "--out", "part", *NO_PLOTS).succeeded()
    found, path, first = summary("part"), strides("part"), strides(saved.with_name("first"))
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
    assert any(note.startswith("on the places of walk.csv") for note in found["notes"])
    assert found["graph"]["known_place"] > 3
    assert "note: on the places of walk.csv, by " in ran.out
    # in the same frame for the next one
    assert np.linalg.norm(read_places(Path("part.places")).path.position[0] - at[["x_m", "y_m", "z_m"]]) < 1.5
    fg_nav("run", recorded("end"), "--config", "part/config.json", *NO_PLOTS, "--out", "again").succeeded()
    assert summary("again")["located"] == located


def test_a_walk_elsewhere_stays_in_its_own_frame_and_says_so(fg_nav: FgNav, saved: Path) -> None:
    fg_nav("run", recorded("other"), "--places", saved, *NO_PLOTS, "--out", "other").succeeded()
    found = summary("other")
    assert found["located"] is None
    assert any("nothing of the saved places was recognized" in note for note in found["notes"])
    assert strides("other")["x_m"][0] == pytest.approx(0.0, abs=1e-3)


def test_places_are_not_overwritten_without_force(fg_nav: FgNav, saved: Path) -> None:
    before, place = saved.read_bytes(), Path("mine.places")
    place.write_bytes(before)
    arguments = ("run", recorded("end"), "--save-places", place, *NO_PLOTS)
    assert fg_nav(*arguments).refused("mine.places already exists", "--force")
    assert place.read_bytes() == before
    fg_nav(*arguments, "--force", "--method", "iez").succeeded()
    assert place.read_bytes() != before
    Path("notes").write_text("mine")
    assert fg_nav("run", recorded("walk"), "--save-places", "notes", "--force").refused("does not write")


def test_what_has_no_use_of_places_is_refused(fg_nav: FgNav, saved: Path) -> None:
    run = ("run", recorded("walk"), "--places", saved)
    assert fg_nav(*run, "--method", "iez").refused("iez makes no use of saved places")
    Path("fixes.csv").write_text("time_s,x_m,y_m,z_m,sigma_m\n20,1,2,,1\n")
    assert fg_nav(*run, "--fixes", "fixes.csv").refused("give one of them")


def test_the_result_of_a_walk_too_short_for_places_is_written_and_the_reason_told(fg_nav: FgNav) -> None:
    first = recording("walk")
    write_canonical(first.slice(0, int(detect_stances(first).stop[6])), Path("short.csv"))
    ran = fg_nav("run", "short.csv", "--save-places", "short.places", "--out", "short", "--quiet")
    assert ran.refused("too short for its places to be saved", "20 m")
    assert summary("short")["strides"]
    assert not Path("short.places").exists()
