"""The command line: its verbs by group; what they do is in `fg_nav.commands`.

`options` has the types of the options. Each verb loads what it needs when it is called, so that the help is quick.

`main` is the one error boundary; its exit codes are in docs/command_line.md.
"""

from __future__ import annotations

import io
import json
import os
import sys
import traceback
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from fg_nav.cli import laboratory, sensors, walks
from fg_nav.errors import FgNavError
from fg_nav.system.processes import collect_seldom

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Before numpy is loaded, here and in processes beside: its matrices are small, and threads that share a busy core wait
for each other in a loop, a hundred times as long as a product takes. Sums are the same on any number of cores, too."""

EXIT_USER, EXIT_BUG, EXIT_INTERRUPTED = 1, 70, 130

app = typer.Typer(
    name="fg-nav",
    help="Turn the recording of a foot-mounted inertial sensor into a trajectory with uncertainties.",
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for group in (walks, sensors, laboratory):  # in the order of the help
    app.add_typer(group.verbs)


def main() -> NoReturn:
    """Run the command line and exit."""
    collect_seldom()
    _open_outputs()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name the terminal cannot show is no bug
    try:
        app()
    except FgNavError as error:
        _leave(" ".join(str(error).split()), EXIT_USER)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        where = "" if error.filename is None else f" ({error.filename})"
        _leave(f"the system refused: {reason.lower()}{where}; check path, permissions and free space.", EXIT_USER)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:
        traceback.print_exc()
        _leave(f"this is a bug ({type(error).__name__}): please report it with the lines above.", EXIT_BUG)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _program(version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False) -> None:
    if version:
        from fg_nav.text import find_version

        typer.echo(f"fg-nav {find_version()}")
        raise typer.Exit


def _open_outputs() -> None:
    """Lead standard streams that are closed nowhere: the next file that is opened would take the place of one."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115


def _leave(words: str, code: int) -> NoReturn:
    as_json = "--json" in sys.argv[1:]  # the command line may have failed before it was understood
    with suppress(OSError):  # the terminal may be gone
        print(json.dumps({"error": words}) if as_json else f"fg-nav: {words}", file=sys.stderr)  # noqa: T201
    sys.exit(code)
