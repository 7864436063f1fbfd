"""The command line: a command of each request (`fg_nav.commands.requests`), the program's errors, and its answers.

Each verb loads what it needs when it is called, so that the help is quick. An answer is printed for people, as JSON for
scripts (`--json`), or not at all (`--quiet`).

`main` is the one error boundary; its exit codes are in docs/command_line.md.
"""

from __future__ import annotations

import io
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from importlib import import_module
from inspect import Parameter, Signature, cleandoc
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_type_hints

import typer

from fg_nav.commands.requests import ALL_WORDS, GROUPS, REQUESTS, Request
from fg_nav.errors import FgNavError, describe_reason
from fg_nav.lab import verbs as laboratory
from fg_nav.system.processes import collect_seldom

if TYPE_CHECKING:
    from fg_nav.commands.shared import Answer

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Before numpy is loaded, here and in processes beside: its matrices are small, and threads that share a busy core wait
for each other in a loop, a hundred times as long as a product takes. Sums are the same on any number of cores, too."""

EXIT_USER, EXIT_BUG, EXIT_INTERRUPTED = 1, 70, 130

SETTINGS: dict[str, Any] = {
    "context_settings": {"help_option_names": ["-h", "--help"]},
    "no_args_is_help": True,
    "pretty_exceptions_enable": False,
}
app = typer.Typer(
    name="fg-nav",
    help="Turn the recording of a foot-mounted inertial sensor into a trajectory with uncertainties.",
    **SETTINGS,
)
lab = typer.Typer(help="The laboratory: simulated walks, fields, campaigns, papers, noise of sensors.", **SETTINGS)


def show_everything(context: typer.Context, is_asked: bool) -> None:
    """Print the help with the verbs and options that are hidden, and all words of the others, and exit."""
    if not is_asked or context.resilient_parsing:
        return
    command: Any = context.command
    for one in (*command.params, *getattr(command, "commands", {}).values()):
        one.hidden = False
        one.help = ALL_WORDS.get(getattr(one, "help", ""), getattr(one, "help", ""))
    typer.echo(context.get_help())
    raise typer.Exit


HELP_ALL: Any = typer.Option(
    False, "--help-all", help="Show what is seldom needed too.", is_eager=True, callback=show_everything
)


def add_command(verbs: typer.Typer, form: type[Request]) -> None:
    """Add the verb of a request: its options are the fields by group, the class's own before those of its bases."""
    module, _, verb = form.verb.partition(":")

    def call(help_all: bool = False, **given: Any) -> None:
        answer(form(**given), getattr(import_module(module), verb))

    items, hints = {item.name: item for item in fields(form)}, get_type_hints(form)
    names = dict.fromkeys(
        name for one in form.__mro__ for name in vars(one).get("__annotations__", ()) if name in items
    )
    groups = (None, *GROUPS)  # arguments are in none
    options = {name: items[name].metadata["typer"] for name in names}
    if any(one.hidden or ALL_WORDS.get(one.help, one.help) != one.help for one in options.values()):
        options, hints = {"help_all": HELP_ALL, **options}, {"help_all": bool, **hints}
    call.__dict__["__signature__"] = Signature(
        [
            Parameter(name, Parameter.KEYWORD_ONLY, default=options[name], annotation=hints[name])
            for name in sorted(options, key=lambda name: groups.index(options[name].rich_help_panel))
        ]
    )
    call.__annotations__ = {name: hints[name] for name in options}
    verbs.command(verb, help=cleandoc(form.__doc__ or ""))(call)


def answer(request: Request, verb: Callable[[Any], Answer]) -> None:
    """Run a verb, log what it says, and print its answer."""
    from fg_nav.report.terminal import log_records

    with log_records(request.quiet, request.verbose, request.log):
        found = verb(request)
        if request.json:
            from fg_nav.text import to_json

            typer.echo(json.dumps(to_json(found.content), indent=2, allow_nan=False))
        elif not request.quiet:
            found.show()
        if found.failure is not None:
            raise found.failure


for form in (*REQUESTS, *laboratory.BESIDE):
    add_command(app, form)
for form in laboratory.BELOW:
    add_command(lab, form)
app.add_typer(lab, name="lab", hidden=True)


def main() -> NoReturn:
    """Run the command line and exit."""
    collect_seldom()
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # what was begun is removed, as by Ctrl-C
    _open_outputs()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name the terminal cannot show is no bug
    try:
        app()
    except FgNavError as error:
        _leave(" ".join(str(error).split()), EXIT_USER)
    except OSError as error:
        where = "" if error.filename is None else f" ({error.filename})"
        _leave(
            f"the system refused: {describe_reason(error)}{where}; check path, permissions and free space.", EXIT_USER
        )
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:
        traceback.print_exc()
        _leave(f"this is a bug ({type(error).__name__}): please report it with the lines above.", EXIT_BUG)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _program(
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
    help_all: bool = HELP_ALL,
) -> None:
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
