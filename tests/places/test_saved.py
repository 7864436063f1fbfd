"""Places in a file: what is read is what was written, and a damaged file is refused in a sentence."""

import zipfile
from contextlib import suppress
from dataclasses import fields

import numpy as np
import pytest

from fg_nav.errors import PlacesError
from fg_nav.places import SavedPlaces, Signature, read_places, trace_places, write_places
from fg_nav.places.saved import COLUMNS, VERSION, is_places
from tests.places.floors import LOOP, Floor, along, carry


@pytest.fixture(scope="module")
def places():
    path = carry(Floor.draw(1), along(LOOP))
    return SavedPlaces(path, np.full((len(path), 3), 0.3), "walk.csv")


@pytest.fixture
def file(places, tmp_path):
    write_places(tmp_path / "office.places", places)
    return tmp_path / "office.places"


def change(file, **changes):
    """Write the file again with other arrays; None leaves one out."""
    with np.load(file) as content:
        arrays = {**content} | changes
    with file.open("wb") as stream:
        np.savez(stream, **{name: array for name, array in arrays.items() if array is not None})


def test_what_is_read_is_what_was_written(file, places):
    assert is_places(file)
    back = read_places(file)
    assert back.recording == "walk.csv"
    assert np.array_equal(back.sigma_m, places.sigma_m)
    for one in fields(Signature):
        assert np.array_equal(getattr(back.path, one.name), getattr(places.path, one.name)), one.name


def test_nothing_is_written_that_cannot_be_read(places, tmp_path):
    file, columns = tmp_path / "office.places", {**vars(places.path), "sigma_m": places.sigma_m}
    spoiled = [
        ({**columns, name: np.full_like(columns[name], wrong)}, f"cannot be saved, .* '{name}'")
        for name in sorted(set(COLUMNS) - {"seen"})
        for wrong in (np.nan, -1e30)
    ]
    for wrong, words in (*spoiled, ({name: column[:5] for name, column in columns.items()}, "5 points")):
        with pytest.raises(PlacesError, match=words):
            write_places(file, SavedPlaces(sigma_m=wrong.pop("sigma_m"), path=Signature(**wrong)))
    assert not file.exists()


@pytest.mark.parametrize("name", COLUMNS)
def test_every_column_is_judged(file, places, name):
    with np.load(file) as content:
        column = content[name]
    wrong = [None, column[:-1], column[..., None], column.astype(np.complex128)]
    if name != "seen":
        wrong += [np.where(np.arange(column.size).reshape(column.shape) == 70, bad, column) for bad in (np.nan, 1e30)]
    if name in ("distance_m", "t", "sigma_m"):
        wrong.append(-column)  # an order or sigmas that cannot be
    for array in wrong:
        write_places(file, places)
        change(file, **{name: array})
        with pytest.raises(PlacesError, match=r"office\.places .*: save"):
            read_places(file)


def test_a_newer_version_and_another_file_are_refused(file, places, tmp_path):
    np.savez(tmp_path / "other.npz", t=np.arange(3.0))
    (tmp_path / "text").write_text("nothing")
    for name, words in (("other.npz", "no places"), ("text", "no places"), ("", "directory"), ("none", "not exist")):
        assert not is_places(tmp_path / name)
        with pytest.raises(PlacesError, match=words):
            read_places(tmp_path / name)
    few = {name: column[:5] for name, column in vars(places.path).items()}
    for changes, words in (
        ({"version": np.array(VERSION + 1)}, f"version {VERSION + 1}"),
        ({"sigma_m": places.sigma_m[:5], **few}, "5 points"),
        ({"recording": np.array([{"a": 1}], dtype=object)}, "damaged"),  # objects are not unpickled
    ):
        write_places(file, places)
        change(file, **changes)
        with pytest.raises(PlacesError, match=words):
            read_places(file)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(60_000_000))
    with pytest.raises(PlacesError, match="larger"):
        read_places(file)


def test_damaged_bytes_are_refused_or_read(file):
    content, rng = file.read_bytes(), np.random.default_rng(1)
    for at in rng.integers(0, len(content), 60):
        changed = content[:at] + bytes([rng.integers(256)]) + content[at + 1 :]
        for damaged in (content[:at], changed):
            file.write_bytes(damaged)
            with suppress(PlacesError):
                read_places(file)


def test_sigmas_are_those_of_the_footfalls_around_and_too_short_a_walk_has_no_places():
    t = np.arange(0.0, 100.0, 0.1)
    position, R, mag = np.outer(t, [1.0, 0.0, 0.0]), np.tile(np.eye(3), (len(t), 1, 1)), np.ones((len(t), 3))
    sigma = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    found = trace_places(t, position, R, mag, t[[0, -1]], sigma)
    assert found.sigma_m[:, 1] == pytest.approx(2.0 * found.path.t / t[-1])
    assert found.path.seen.all()
    with pytest.raises(PlacesError, match="too short"):
        trace_places(t[:100], position[:100], R[:100], mag[:100], t[:2], sigma)
