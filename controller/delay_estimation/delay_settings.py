"""Settings of the delay estimation: the table [delay_estimation]."""

from typing import Annotated

from pydantic import Field

from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import Settings
from ..filters.settings import NominalModelSettings, VehicleModelSettings
from .estimation import DelayEstimationParams


class DelayEstimationSettings(Settings):
    """[delay_estimation]: the delay estimated from command and response; no law uses it."""

    enabled: bool = True
    delay_s_max: Annotated[float, Field(ge=0.1, le=2.0)] = 1.0
    """Largest delay to search for."""
    window_s: Annotated[float, Field(ge=2.0, le=120.0)] = 10.0
    """Time constant of forgetting: how fast a delay that changes is followed."""
    tolerance_ms: Annotated[float, Field(ge=1.0, le=200.0)] = 10.0
    """The confidence is the probability of an error within this."""
    confidence_min: Annotated[float, Field(ge=0.5, le=0.999)] = 0.95
    """From this confidence on the delay counts as observable."""
    mass_over_nominal: Annotated[float, Field(ge=0.1, le=10.0)] = 1.65
    """Mass for computing the vehicle's own lag, relative to that of [nominal_model]. The default is
    the middle of 1600 to 5000 kg for a nominal 2000 kg."""


def delay_estimation_of(
    table: DelayEstimationSettings, model: NominalModelSettings | None, period_ns: int
) -> DelayEstimationParams | None:
    """Return the estimation's parameters, None if it is off or there is no nominal vehicle."""
    if not table.enabled or not isinstance(model, VehicleModelSettings):
        return None
    vehicle = model.vehicle
    return DelayEstimationParams(
        period_s=period_ns / NS_PER_S,
        vehicle=vehicle._replace(virtual_mass_kg=vehicle.virtual_mass_kg * table.mass_over_nominal),
        delay_s_max=table.delay_s_max,
        window_s=table.window_s,
        tolerance_s=table.tolerance_ms * NS_PER_MS / NS_PER_S,
        confidence_min=table.confidence_min,
    )
