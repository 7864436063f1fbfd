"""What a refusal of the command line proposes, found in its sentence and tried: `tests.commands.test_refusals`.

A whole command (`fg-nav inspect ...`) is called as it is written; an option with its value that is to be added or left
out is added to the refused command, or taken from it. What is accepted ends where the work would begin or a file be
written: all checks before that are passed. Files that are to be made first and names in capitals are left to the user;
an option that is named without its value is looked up. Sentences that differ in paths and numbers are tried once.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any, NoReturn

import pytest
import typer

from fg_nav import cli
from tests.command_line import FgNav, Ran

WORK = (
    "run_method",
    "estimate",
    "smooth_feet",
    "open_samples",
    "fill_folder",
    "claim_folder",
    "result_file",
    "result_files",
)
"""Functions, of whatever module, where the work begins or a file is written."""

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*[a-z]")
OPEN = re.compile(r"\b[A-Z]{3,}\b|\bA,B\b")  # Names in capitals, left to the user.
VALUE = r"(?:=[^\s`;:)]+| (?!(?:and|or|in|to|for|with|if)\b)(?:'[^']*'|(?:[^\s`.,;:)]|[.,](?=[\w-]))+))?"
ADDED = re.compile(
    rf"(?:such as|add|try|by|(?<!out )with|give|, or) (?:`(--[^`]+)`|`fg-nav [a-z]+ (--[^`]+)`|(--[a-z-]+{VALUE}))"
)
REMOVED = re.compile(
    r"leave ((?:--[a-z-]+(?:, | and |, and )?)+)(?: [a-z]+)? out|leave out ((?:--[a-z-]+(?: and )?)+)|"
    r"^((?:--[a-z-]+(?:, | and )?)+) (?:is|are) .* leave (?:it|them) out"
)

_tried = set[str]()


class AcceptedError(BaseException):
    """The command passed all its checks."""


def list_commands(words: str) -> list[list[str]]:
    """Arguments of the commands of fg-nav that a refusal names, each without the program's own name."""
    found = []
    for quote, text in re.findall(r"([`'\"]?)fg-nav ([a-z].*?)(?=[`'\"]?fg-nav [a-z]|$)", words):
        if quote and quote in text:
            text = text.split(quote)[0]
        else:
            text = re.split(r", or |; ", text)[0].rstrip(".`' ")
            quoted = text.split('"')
            text = '"'.join(quoted[:2]) + '"' if len(quoted) > 2 else text.split(", with ")[0].split(":")[0]
        found.append(_split(text))
    return [command for command in found if _name(command) in _commands()]


def list_changes(words: str, arguments: Sequence[str]) -> list[list[str]]:
    """Arguments of the refused command with options that the refusal says to add, or without those to leave out."""
    options, found = _commands()[_name(arguments)], list[list[str]]()
    for text in map("".join, ADDED.findall(words)):
        added = _split(text)
        if OPEN.search(text):
            continue
        left = list(arguments)
        for option in OPTION.findall(text):
            left = _without(left, option, options)
        has_value = len(added) > 1 or "=" in text or options.get(text, False)
        if has_value and sorted([*left, *added]) != sorted(arguments):
            found.append([*left, *added])
    for removed in REMOVED.findall(words):
        left = list(arguments)
        for option in OPTION.findall("".join(removed)):
            left = _without(left, option, options)
        if left != list(arguments):
            found.append(left)
    return found


def check_proposals(fg_nav: FgNav, arguments: Sequence[object], ran: Ran) -> int:
    """Try what the refusal of a call with these arguments proposes; return how many proposals there were."""
    arguments, words = list(map(str, arguments)), ran.err.strip().removeprefix("fg-nav: ")
    command = next((word for word in arguments if word in _commands()), None)
    pattern = re.sub(r"\S*/\S*|\d+", "#", words)
    if command is None or pattern in _tried:
        return 0
    _tried.add(pattern)
    commands = list_commands(words)
    # there is each option that is named
    known = {opt for name in (command, *map(_name, commands)) for opt in _commands()[name]}
    unknown = set(OPTION.findall(words)) - known - set(OPTION.findall(" ".join(arguments)))
    assert not unknown, f"{words}\nnames {unknown}, which are no options of {command}"
    is_to_be_made = re.search("export .* as a table", words) is not None
    # with what it reads behind it
    named = [one for one in commands if not [*one, "--"][1 + (one[0] == "lab")].startswith("--")]
    whole = [one for one in named if not is_to_be_made and not OPEN.search(" ".join(one))]
    changed = list_changes(words, arguments)
    for again in [*whole, *changed]:
        with pytest.MonkeyPatch.context() as patch:
            _stop_at_work(patch)
            try:
                said = fg_nav(*again)
            except AcceptedError:
                continue
        added = OPTION.findall(" ".join(set(again) - set(arguments)))
        is_of_another = again in changed and said.err != ran.err and set(added).isdisjoint(OPTION.findall(said.err))
        assert said.code == 0 or is_of_another, f"{words}\nproposes {shlex.join(again)}\nwhich says: {said.err}"
    return len(whole) + len(changed)


def _stop_at_work(patch: pytest.MonkeyPatch) -> None:
    def accept(*_: object, **__: object) -> NoReturn:
        raise AcceptedError

    for name, module in list(sys.modules.items()):
        if name.startswith("fg_nav."):
            for function in WORK:
                if callable(getattr(module, function, None)):
                    patch.setattr(module, function, accept)


@cache
def _commands() -> dict[str, dict[str, bool]]:
    """Options of each command, and whether each is a flag."""
    group: Any = typer.main.get_command(cli.app)
    commands = {name: one for name, one in (group.commands | group.commands["lab"].commands).items() if name != "lab"}
    options = {name: [p for p in one.params if hasattr(p, "is_flag")] for name, one in commands.items()}
    return {name: {opt: p.is_flag for p in own for opt in p.opts} for name, own in options.items()}


def _name(command: Sequence[str]) -> str:
    """Return the name of the command, of the laboratory or not."""
    return command[command[0] == "lab" and len(command) > 1]


def _split(text: str) -> list[str]:
    """Words of a command, as a shell splits them; a sentence with an apostrophe at its blanks."""
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()


def _without(arguments: Sequence[str], option: str, options: dict[str, bool]) -> list[str]:
    left, words = list[str](), list(arguments)
    while words:
        word = words.pop(0)
        if word == option and not options.get(option) and words:
            words.pop(0)
        elif word != option and not word.startswith(f"{option}="):
            left.append(word)
    return left
