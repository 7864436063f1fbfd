"""Parameters of a method by their dotted names, `magnetic.rounds`, in place of those it has."""

from __future__ import annotations

import typing
from dataclasses import fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import Any, TypeAlias, TypeVar, cast

from fg_nav.errors import EstimationError

Scalar: TypeAlias = bool | int | float | str

Changes: TypeAlias = tuple[tuple[str, Scalar], ...]
"""Dotted names and values."""

LARGEST = 1e100
"""No parameter is larger; whole numbers beyond a float's range would not even compare."""

SCALARS = (bool, int, float, str)

T = TypeVar("T")


def change_parameters(parameters: T, changes: Changes) -> T:
    """Return a dataclass of parameters with some of them, or of those in it, replaced.

    Raises
    ------
    EstimationError
        For a name that is none, and a value of another type.
    """
    for name, value in changes:
        parameters = _replace(parameters, name.split("."), value, name)
    return parameters


def _replace(parameters: T, path: list[str], value: Scalar, whole: str) -> T:
    known = [item.name for item in fields(cast("Any", parameters))]
    head, *rest = path
    if head not in known:
        raise EstimationError(f"there is no parameter '{whole}': choose one of {', '.join(known)}.")
    before = getattr(parameters, head)
    if is_dataclass(before) and not rest:
        inner = ", ".join(f"{whole}.{item.name}" for item in fields(before))
        raise EstimationError(f"the parameter '{whole}' has parts: choose one of {inner}.")
    if rest and not is_dataclass(before):
        raise EstimationError(f"there is no parameter '{whole}': {head} has no parts.")
    new = _replace(before, rest, value, whole) if rest else _convert(type(parameters), head, value, whole)
    return cast("T", replace(cast("Any", parameters), **{head: new}))


def _convert(owner: type, name: str, value: Scalar, whole: str) -> Scalar:
    """Return the value as the field has it: a whole number is a real one too, and nothing else is something else."""
    hint = typing.get_type_hints(owner)[name]
    literal = typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()
    if value in literal:
        return value
    kinds = typing.get_args(hint) if isinstance(hint, UnionType) or typing.get_origin(hint) is typing.Union else (hint,)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
    if float in kinds and is_number:
        return float(value)
    if type(value) in kinds and type(value) is not float:
        return value
    raise EstimationError(f"the parameter '{whole}' cannot be {value!r}: give {_describe_kinds(literal, kinds)}.")


def _describe_kinds(literal: tuple[Any, ...], kinds: tuple[Any, ...]) -> str:
    words = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
    if literal:
        return f"one of {', '.join(map(str, literal))}"
    kinds_known = [words[kind] for kind in kinds if kind in SCALARS]
    named = " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds if kind is not NoneType)
    return " or ".join(kinds_known) or f"it in Python, where it is a {named}"
