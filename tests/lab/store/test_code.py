"""What stored results rest on: sources, and what these run on."""

import sys
from importlib import metadata

import pytest

from fg_nav.lab.store import code


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "one.py"
    path.write_text("A = 1\n")
    yield path
    code.describe_runtime.cache_clear()


def sum_of(path) -> str:
    code.describe_runtime.cache_clear()
    return code.sum_sources([path])


def test_another_version_of_a_library_or_of_python_makes_another_sum(source, monkeypatch):
    installed, before, (major, minor, micro, *rest) = metadata.version, sum_of(source), sys.version_info
    for name in code.LIBRARIES:
        assert f"{name} {installed(name)}" in code.describe_runtime()
        with monkeypatch.context() as patch:
            patch.setattr(metadata, "version", lambda one, name=name: "99.0" if one == name else installed(one))
            assert sum_of(source) != before
        assert sum_of(source) == before
    monkeypatch.setattr(sys, "version_info", (major, minor, micro + 1, *rest))
    assert sum_of(source) == before
    monkeypatch.setattr(sys, "version_info", (major, minor + 1, micro, *rest))
    assert sum_of(source) != before


def test_a_library_that_nobody_installed_has_a_version_too(source, monkeypatch):
    def none(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", none)
    sum_of(source)
    assert "gtsam unknown, numpy unknown" in code.describe_runtime()
