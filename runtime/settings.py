"""Settings files: TOML in, frozen and checked pydantic models out, one clear line for each mistake."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Base of every settings table: frozen, unknown keys refused, numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
