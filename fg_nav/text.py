"""What people and files say: parameters by their dotted names (`magnetic.rounds`), counts, values as JSON, versions."""

from __future__ import annotations

import difflib
import errno
import json
import math
import re
import shlex
import tomllib
import typing
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from html import escape
from pathlib import Path
from reprlib import repr as shorten
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

from fg_nav.errors import EstimationError, FormatError

if TYPE_CHECKING:
    from pydantic import ValidationError

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | list[Any] | None
Changes: TypeAlias = tuple[tuple[str, Value], ...]  # Dotted names and values.

DETECTOR = "detector"  # First part of the names of the parameters of the stances.
MAX_VALUE, MAX_WHOLE = 1e70, 1000  # No parameter is larger, and no whole one, which counts rounds or footfalls.
CUT = "only rows"  # Begins the note on a recording of which parts are left out.
MAX_BYTES = 2**23  # Of a configuration, a calibration or a scenario, which are some kilobytes.

T = TypeVar("T")


# --- parameters by their names ---------------------------------------------------------------------------------------


def change_parameters(parameters: T, changes: Changes, owner: str = "") -> T:
    """Return the dataclass `parameters` with each (name, value) of `changes` set; dotted names reach nested ones.

    `owner` is put before the name in an error. Raises `EstimationError` if there is no such parameter, or its value is
    of another type.
    """
    known = list(list_names(parameters)) if changes else []
    for name, value in changes:
        if name not in known:
            raise EstimationError(explain_no_parameter(name, known))
        # the dataclasses on the way to it, the outermost first
        path, nested = name.split("."), [cast("Any", parameters)]
        for part in path[:-1]:
            nested.append(getattr(nested[-1], part))
        new = _convert(nested[-1], path[-1], value, f"{owner}.{name}" if owner else name)
        for inner, part in zip(reversed(nested), reversed(path), strict=True):
            new = replace(inner, **{part: new})
        parameters = cast("T", new)
    return parameters


def list_names(parameters: object) -> Iterator[str]:
    """Yield the dotted name of every parameter in a dataclass, and in those in it."""
    for item in fields(cast("Any", parameters)):
        inner = getattr(parameters, item.name)
        if is_dataclass(inner):
            yield from (f"{item.name}.{name}" for name in list_names(inner))
        else:
            yield item.name


def explain_no_parameter(name: str, known: Sequence[str]) -> str:
    """Return the sentence for a name that is none of the known ones: the nearest of them, or all."""
    parts = [other for other in known if other.startswith(f"{name}.")]
    if parts:
        return f"the parameter '{name}' has parts: choose one of {', '.join(parts)}."
    near = difflib.get_close_matches(name, known, 1)
    advice = f"the nearest is '{near[0]}'" if near else f"choose one of {', '.join(known)}"
    return f"there is no parameter '{name}': {advice}."


def select_changes(changes: Changes, owner: str) -> Changes:
    """Return the changes with this first part of their name, without it."""
    return tuple((name.removeprefix(f"{owner}."), value) for name, value in changes if name.startswith(f"{owner}."))


def flatten(content: Mapping[str, Any], owner: str) -> Changes:
    """Return the values of nested mappings as changes, after this first part of their name."""
    found: list[tuple[str, Value]] = []
    for key, value in content.items():
        name = f"{owner}.{key}"
        found += flatten(value, name) if isinstance(value, Mapping) else [(name, value)]
    return tuple(found)


def _convert(owner: object, name: str, value: Value, whole: str) -> object:
    """Return `value` in the type of the field `name`; an integer passes as a float, any other mismatch raises."""
    hint, before = typing.get_type_hints(type(owner))[name], getattr(owner, name)
    literal = typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()
    is_union = isinstance(hint, UnionType) or typing.get_origin(hint) is typing.Union
    kinds = typing.get_args(hint) if is_union else (hint,)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MAX_VALUE
    # a positive default is a sigma, a density or a time: a negative value makes no sense
    is_positive = isinstance(before, int | float) and not isinstance(before, bool) and before > 0
    if value in literal or (value is None and NoneType in kinds):
        return value
    give = _describe_kinds(literal, kinds)
    if isinstance(value, list):
        from pydantic import TypeAdapter, ValidationError

        if all(abs(one) < MAX_VALUE for one in value if isinstance(one, int | float)):
            with suppress(ValidationError):
                return TypeAdapter(hint).validate_json(json.dumps(value), strict=True)
    elif is_number and is_positive and cast("float", value) < 0:
        give = "a number that is not below zero"
    elif float in kinds and is_number:
        return float(cast("float", value))
    elif isinstance(value, int) and float not in kinds and value > MAX_WHOLE:
        give = f"a whole number up to {MAX_WHOLE}"
    elif type(value) in kinds and type(value) is not float:
        return value
    raise EstimationError(f"the parameter '{whole}' cannot be {shorten(value)}: give {give}.")


def _describe_kinds(literal: tuple[Any, ...], kinds: tuple[Any, ...]) -> str:
    """Return what a parameter may be, in words."""
    words = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
    if literal:
        return f"one of {', '.join(map(str, literal))}"
    known = [words[kind] for kind in kinds if kind in words]
    if any(typing.get_origin(kind) is tuple for kind in kinds):
        known.append("a list such as [0.1, 0, 0.2]")
    named = " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds if kind is not NoneType)
    return " or ".join(known) or f"it in Python, where it is a {named}"


# --- sentences and files ---------------------------------------------------------------------------------------------


def format_digits(value: float, digits: int = 3, decimals: int = 3) -> str:
    """Write a number with so many significant digits, and not more than so many decimals; no exponent, no -0."""
    if not math.isfinite(value):
        return "-"
    places = min(digits - 1 - math.floor(math.log10(abs(value) or 1.0)), decimals)
    return f"{round(value, places):z.{max(places, 0)}f}"


def format_count(count: int, thing: str) -> str:
    """Put a count before a thing, and an s behind it if there is not one of it."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def format_ratio(ratio: float) -> str:
    """Write a ratio with two digits that count, and without an exponent below a million: 0.031, 4.1, 410."""
    return f"{float(f'{ratio:.2g}'):g}"


def to_json(value: object) -> Any:
    """Return `value` for JSON: dataclasses and arrays as dicts and lists, non-finite as None, the rest as text."""
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: to_json(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # of numpy, which the help does not load
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)


def to_html(title: str, rows: Sequence[tuple[str, str]], below: str = "") -> str:
    """Return a small table of names and values with a title, for notebooks; `below` is HTML."""
    cells = (f"<tr><th>{escape(name)}</th><td>{escape(words)}</td></tr>" for name, words in rows)
    return f"<table><caption>{escape(title)}</caption>{''.join(cells)}</table>{below}"


def read_small(path: Path) -> bytes:
    """Return the bytes of a small file; bounded, because the path may be a device that never ends."""
    with path.open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise OSError(errno.EFBIG, f"it holds more than {MAX_BYTES >> 20} MiB", str(path))
    return content


def parse_toml(content: bytes) -> dict[str, Any]:
    """Return the tables of a TOML file; raises `FormatError` with the reason where it is none."""
    try:
        found = tomllib.loads(content.decode("utf-8-sig"))
        json.dumps(found, default=str)  # what is too deep for this is too deep for all
        return found
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FormatError(f"it is no TOML: {error}.") from None
    except (ValueError, RecursionError):  # Python reads so many digits only, and lists in so many lists
        raise FormatError("it has a number too long or a list too deep to be read: correct it.") from None


def describe_invalid(error: ValidationError, kind: object) -> str:
    """One sentence on the first value that pydantic refused in a file or a dataclass: which key, and what to give.

    `kind` is the model or dataclass of the whole, whose names are given for an unknown key.
    """
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    said = first["msg"].removeprefix("Value error, ").replace("Input should be", "give")
    words = re.sub(r" or (an )?instance of \w+", "", said)
    if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        *table, key = path
        return (
            f"{'.'.join(table) or 'the file'} has no parameter '{key}': it knows {', '.join(_list_keys(kind, table))}."
        )
    if first["type"] == "missing":
        return f"{'.'.join(path)} is missing: give it."
    return f"{'.'.join(path)} cannot be {shorten(first['input'])}: {words}." if path else f"{words}."


def _list_keys(kind: object, table: Sequence[str]) -> list[str]:
    """Return the names that a model or dataclass has, or the one in it that stands at this place."""
    place = iter(table)
    for part in place:
        hint = typing.get_type_hints(kind)[part]
        if typing.get_origin(hint) is dict:
            next(place)  # a key of the user's own
        kind = next(one for one in (hint, *typing.get_args(hint)) if is_dataclass(one) or hasattr(one, "model_fields"))
    return list(typing.get_type_hints(kind))


def find_version() -> str:
    """Version of the installed distribution, or words that say there is none."""
    from importlib import metadata  # slow to load, and the help has no version

    try:
        return metadata.version("fg-nav")
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"


def suggest_install(extra: str) -> str:
    """Return the command that installs what an extra brings: by the packages' names, which need no checkout of ours."""
    from importlib import metadata

    try:
        needed = [re.match(rf"(.+?) *; *extra == .{extra}.$", one) for one in metadata.requires("fg-nav") or ()]
    except metadata.PackageNotFoundError:
        needed = []
    return shlex.join(["pip", "install", *([one[1] for one in needed if one] or [f".[{extra}]"])])
