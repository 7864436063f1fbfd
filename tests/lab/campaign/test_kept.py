"""What kept results rest on: sources, and what these run on."""

import sys
from importlib import metadata

import pytest

from fg_nav.lab.campaign import kept


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "one.py"
    path.write_text("A = 1\n")
    yield path
    kept.runs_on.cache_clear()


def sum_of(path) -> str:
    kept.runs_on.cache_clear()
    return kept.sum_over([path])


@pytest.mark.parametrize("name", kept.LIBRARIES)
def test_another_version_of_a_library_makes_another_sum(source, monkeypatch, name):
    installed, before = metadata.version, sum_of(source)
    assert sum_of(source) == before
    assert f"{name} {installed(name)}" in kept.runs_on()
    monkeypatch.setattr(metadata, "version", lambda one: "99.0" if one == name else installed(one))
    assert sum_of(source) != before


def test_another_python_makes_another_sum_where_it_can_change_figures(source, monkeypatch):
    before, (major, minor, micro, *rest) = sum_of(source), sys.version_info
    monkeypatch.setattr(sys, "version_info", (major, minor, micro + 1, *rest))
    assert sum_of(source) == before
    monkeypatch.setattr(sys, "version_info", (major, minor + 1, micro, *rest))
    assert sum_of(source) != before


def test_a_library_that_nobody_installed_has_a_version_too(source, monkeypatch):
    def none(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", none)
    sum_of(source)
    assert kept.runs_on().endswith("gtsam unknown, numpy unknown, scipy unknown, numba unknown, pandas unknown")
