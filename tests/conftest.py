import sys
from pathlib import Path

import pytest

from fg_nav import cli
from tests.command_line import FgNav, Ran
from tests.pictures import sketch_pictures
from tests.proposals import check_proposals


@pytest.fixture
def fg_nav(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> FgNav:
    """Call the command line's entry point in an empty working directory; what a refusal proposes is tried."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    sketch_pictures(monkeypatch)

    def call_once(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, "argv", ["fg-nav", *map(str, arguments)])
        try:
            with pytest.raises(SystemExit) as left:
                cli.main()
        finally:
            said = capsys.readouterr()
        code = left.value.code
        return Ran(code if isinstance(code, int) else 0, said.out, said.err)

    def call(*arguments: object) -> Ran:
        ran = call_once(*arguments)
        if ran.code == 1:
            check_proposals(call_once, arguments, ran)
        return ran

    return call
