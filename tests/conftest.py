import os
import sys
from pathlib import Path

import pytest

from fg_nav import cli
from tests.command_line import FgNav, Ran
from tests.pictures import sketch_pictures

os.environ["PYTHONSAFEPATH"] = "1"  # the processes of the tests import the installed package, not what lies around them


@pytest.fixture
def fg_nav(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> FgNav:
    """Call the command line's entry point in an empty working directory."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    sketch_pictures(monkeypatch)

    def call(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, "argv", ["fg-nav", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        said = capsys.readouterr()
        code = left.value.code
        return Ran(code if isinstance(code, int) else 0, said.out, said.err)

    return call


@pytest.fixture
def solved_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `fg-nav stream` solve its walk in this process: another one takes seconds to begin."""
    from fg_nav.commands import stream

    options = stream.StreamOptions
    monkeypatch.setattr(stream, "StreamOptions", lambda **given: options(**given | {"background": False}))
