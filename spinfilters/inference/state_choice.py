"""Which blocks the state of a run has: what its sensors observe, and the constants that the settings ask for."""

from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.sensor_registry import sensors_in
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import Settings


def layout_of(log: MeasurementLog, settings: Settings) -> StateLayout:
    """Layout of what the sensors observe, with the constants that the settings ask for."""
    sensors = sensors_in(log)
    layout = StateLayout(FULL_BLOCKS if any(sensor.sees_place for sensor in sensors) else ROTATION_BLOCKS)
    for block in BLOCKS.values():
        is_asked = block.switch and getattr(settings.process, block.switch) in block.switched_by
        if is_asked and (layout.translates or not block.translational):
            layout = layout.joined(block)
    for block in (block for sensor in sensors for block in sensor.error_blocks):
        if settings.initialisation.states_prior(block):
            layout = layout.joined(block)
    return layout
