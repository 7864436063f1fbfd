"""Parameters that are what their annotations allow: pydantic checks each, and the wrong one is named."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, TypeAlias, cast, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from fg_nav.errors import SimulationError

Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Share: TypeAlias = Annotated[float, Field(ge=0.0, le=0.5)]
"""Of what scatters: a standard deviation of a half is as much as can be."""

Triple: TypeAlias = tuple[Finite, Finite, Finite]
Spread: TypeAlias = tuple[NotNegative, NotNegative, NotNegative]
"""Along three axes; of standard deviations."""


@dataclass(frozen=True)
class Checked:
    """A dataclass whose fields hold what their annotations allow; raises `SimulationError` naming the wrong one."""

    def __post_init__(self) -> None:
        """Check all fields."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        try:
            _find_model(cast(Any, type(self))).model_validate(values)
        except ValidationError as error:
            raise SimulationError(f"{describe_wrong(error)[:-1]} in a {type(self).__name__}.") from None


@cache
def _find_model(kind: Any) -> type[BaseModel]:
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, arbitrary_types_allowed=True)
    columns: dict[str, Any] = {item.name: (hints[item.name], ...) for item in fields(kind)}
    return create_model(kind.__name__, __config__=config, **columns)


def describe_wrong(error: ValidationError) -> str:
    """One sentence on the first value that is wrong: which key, and what to give instead."""
    first = error.errors()[0]
    name = ".".join(str(part) for part in first["loc"])
    return f"{name} cannot be {shorten(repr(first['input']))}: {first['msg'].replace('Input should be', 'give')}."


def shorten(text: str, most: int = 80) -> str:
    """Cut a text that is too long for a sentence."""
    return text if len(text) <= most else f"{text[:most]}..."
