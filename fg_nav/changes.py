"""Parameters of a method by their dotted names, `magnetic.rounds`, in place of those it has."""

from __future__ import annotations

import difflib
import json
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from reprlib import repr as shorten
from types import NoneType, UnionType
from typing import Any, TypeAlias, TypeVar, cast

from fg_nav.errors import EstimationError

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | list[Any] | None
Changes: TypeAlias = tuple[tuple[str, Value], ...]  # Dotted names and values.

DETECTOR = "detector"  # First part of the names of the parameters of the stances.

LARGEST, MOST = 1e100, 1000  # No parameter is larger, and no whole one, which counts rounds or footfalls.

SCALARS = (bool, int, float, str)

T = TypeVar("T")


def change_parameters(parameters: T, changes: Changes, owner: str = "") -> T:
    """Return the dataclass `parameters` with each (name, value) of `changes` set; dotted names reach nested ones.

    `owner` is put before the name in an error.

    Raises
    ------
    EstimationError
        If there is no such parameter, or its value is of another type.
    """
    known = list(list_names(parameters)) if changes else []
    for name, value in changes:
        if name not in known:
            raise EstimationError(explain_no_parameter(name, known))
        parameters = _replace(parameters, name.split("."), value, f"{owner}.{name}" if owner else name)
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
    if near:
        return f"there is no parameter '{name}': the nearest is '{near[0]}'."
    return f"there is no parameter '{name}': choose one of {', '.join(known)}."


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


def _replace(parameters: T, path: list[str], value: Value, whole: str) -> T:
    head, *rest = path
    before = getattr(parameters, head)
    new = _replace(before, rest, value, whole) if rest else _convert(parameters, head, value, whole)
    return cast("T", replace(cast("Any", parameters), **{head: new}))


def _convert(owner: object, name: str, value: Value, whole: str) -> object:
    """Return `value` in the type of the field `name`; an integer passes as a float, any other mismatch raises."""
    hint = typing.get_type_hints(type(owner))[name]
    literal = typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()
    if value in literal:
        return value
    kinds = typing.get_args(hint) if isinstance(hint, UnionType) or typing.get_origin(hint) is typing.Union else (hint,)
    if isinstance(value, list):
        from pydantic import TypeAdapter, ValidationError

        try:
            return TypeAdapter(hint).validate_json(json.dumps(value), strict=True)
        except ValidationError:
            words = f"the parameter '{whole}' cannot be {shorten(value)}: give {_describe_kinds((), kinds)}."
            raise EstimationError(words) from None
    if value is None and NoneType in kinds:
        return None
    cannot = f"the parameter '{whole}' cannot be {shorten(value)}"
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
    before = getattr(owner, name)
    # a positive default is a sigma, a density or a time: a negative value makes no sense
    is_positive = isinstance(before, int | float) and not isinstance(before, bool) and before > 0
    if is_number and is_positive and cast("float", value) < 0:
        raise EstimationError(f"{cannot}: give a number that is not below zero.")
    if float in kinds and is_number:
        return float(cast("float", value))
    if isinstance(value, int) and float not in kinds and value > MOST:
        raise EstimationError(f"{cannot}: give a whole number up to {MOST}.")
    if type(value) in kinds and type(value) is not float:
        return value
    raise EstimationError(f"{cannot}: give {_describe_kinds(literal, kinds)}.")


def _describe_kinds(literal: tuple[Any, ...], kinds: tuple[Any, ...]) -> str:
    words = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
    if literal:
        return f"one of {', '.join(map(str, literal))}"
    kinds_known = [words[kind] for kind in kinds if kind in SCALARS]
    if any(typing.get_origin(kind) is tuple for kind in kinds):
        kinds_known.append("a list such as [0.1, 0, 0.2]")
    named = " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds if kind is not NoneType)
    return " or ".join(kinds_known) or f"it in Python, where it is a {named}"
