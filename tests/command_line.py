"""How tests call the command line."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fg_nav import cli


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str

    def succeeded(self) -> Ran:
        """The same, of exit code 0."""
        assert self.code == 0, self.err
        return self

    def refused(self, *words: str) -> bool:
        """Exit code 1, one line on standard error that says all `words`, and nothing else."""
        line = self.err.rstrip("\n")
        one_line = line.startswith("fg-nav: ") and "\n" not in line and not self.out
        return self.code == 1 and one_line and all(word in line for word in words)


FgNav = Callable[..., Ran]


def in_a_process(*arguments: object, cwd: Path | None = None, python: tuple[str, ...] = (), **environment: str) -> Ran:
    """Run the command line as a program of its own, both outputs in pipes."""
    words = [sys.executable, *python, "-m", "fg_nav", *map(str, arguments)]
    variables = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[2])} | environment
    ran = subprocess.run(words, capture_output=True, text=True, check=False, cwd=cwd, env=variables)
    return Ran(ran.returncode, ran.stdout, ran.stderr)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}
