"""The base of every recipe table: immutable, every key known, every number finite."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """One table of a recipe. The unit of a number is the end of its name (`_m`, `_ms`, `_v`, ...)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)
