"""Parameters that are what their annotations allow: pydantic checks each, and the wrong one is named."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, Self, TypeAlias, cast, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from fg_nav.errors import SimulationError
from fg_nav.text import describe_invalid

Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Share: TypeAlias = Annotated[float, Field(ge=0.0, le=0.5)]
"""Of what scatters: a standard deviation of a half is as much as can be."""

Triple: TypeAlias = tuple[Finite, Finite, Finite]
Spread: TypeAlias = tuple[NotNegative, NotNegative, NotNegative]
"""Along three axes; of standard deviations."""


class Table(BaseModel):
    """A table of a file: no other keys, and no value of another type."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @classmethod
    def read(cls, content: Mapping[str, Any]) -> Self:
        """Read it; raises `SimulationError` naming the first key that is wrong.

        Read as JSON, where lists are tuples and whole numbers are numbers, but nothing else is converted.
        """
        try:
            return cls.model_validate_json(json.dumps(content, default=str))
        except ValidationError as error:
            raise SimulationError(describe_invalid(error, cls)) from None


@dataclass(frozen=True)
class Checked:
    """A dataclass whose fields hold what their annotations allow; raises `SimulationError` naming the wrong one."""

    def __post_init__(self) -> None:
        """Check all fields."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        try:
            _find_model(cast(Any, type(self))).model_validate(values)
        except ValidationError as error:
            kind = type(self)
            raise SimulationError(f"{describe_invalid(error, kind)[:-1]} in a {kind.__name__}.") from None


@cache
def _find_model(kind: Any) -> type[BaseModel]:
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, arbitrary_types_allowed=True)
    columns: dict[str, Any] = {item.name: (hints[item.name], ...) for item in fields(kind)}
    return create_model(kind.__name__, __config__=config, **columns)


def check_known(what: str, name: str, known: Collection[str]) -> None:
    """Raise `SimulationError` if there is no such thing of this name."""
    if name not in known:
        raise SimulationError(f"there is no {what} '{name}': choose one of {', '.join(known)}.")
