"""Which blocks the state of a run has: what its sensors observe, and the constants that the settings ask for."""

from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.sensor_registry import sensors_in
from spinfilters.models.state_blocks import ACCELERATION, DRAG, LINEAR_DRAG, ROTOR, TORQUE
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import LINEAR, Settings


def layout_of(log: MeasurementLog, settings: Settings) -> StateLayout:
    """Layout of what the sensors observe, with the constants that the settings ask for."""
    sensors = sensors_in(log)
    layout = StateLayout(FULL_BLOCKS if any(sensor.sees_place for sensor in sensors) else ROTATION_BLOCKS)
    # "auto" has been decided where epochs are smoothed, and is quadratic where they are not
    if settings.process.drag:
        layout = layout.joined(LINEAR_DRAG if settings.process.drag == LINEAR else DRAG)
    if settings.process.gravity is True and layout.translates:
        layout = layout.joined(ACCELERATION)
    if settings.process.body_torque:
        layout = layout.joined(TORQUE)
    if settings.process.rotor:
        layout = layout.joined(ROTOR)
    for block in (block for sensor in sensors for block in sensor.error_blocks):
        if settings.initialisation.states_prior(block):
            layout = layout.joined(block)
    return layout
