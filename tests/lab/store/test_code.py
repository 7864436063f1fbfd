"""What stored results rest on: sources, and what these run on."""

import sys
from importlib import metadata

from fg_nav.lab.store import code


def test_another_statement_library_or_python_makes_another_sum_and_comments_do_not(tmp_path, monkeypatch):
    path = tmp_path / "one.py"

    def sum_of(text="A = 1\n"):
        path.write_text(text)
        code.describe_runtime.cache_clear()
        return code.sum_sources([path])

    before, installed, (major, minor, micro, *rest) = sum_of(), metadata.version, sys.version_info
    assert sum_of('"""Docs."""\nA = (1)  # one\n') == before != sum_of("A = 2\n")
    for name in code.LIBRARIES:
        assert f"{name} {installed(name)}" in code.describe_runtime()
        with monkeypatch.context() as patch:
            patch.setattr(metadata, "version", lambda one, name=name: "99.0" if one == name else installed(one))
            assert sum_of() != before
    for version, same in (((major, minor, micro + 1), True), ((major, minor + 1, micro), False)):
        with monkeypatch.context() as patch:
            patch.setattr(sys, "version_info", (*version, *rest))
            assert (sum_of() == before) == same

    def none(name):
        raise metadata.PackageNotFoundError(name)

    with monkeypatch.context() as patch:
        patch.setattr(metadata, "version", none)
        sum_of()
        assert "gtsam unknown, numpy unknown" in code.describe_runtime()
    assert sum_of() == before
    assert code.sum_sources([path], "") != before
    assert code.source_sum() != code.code_sum()
