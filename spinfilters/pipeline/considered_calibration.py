"""Deviations of the calibration that a run considers.

Settings first, then the data set's own, then priors.
"""

from spinfilters.data.consider_parameter import ConsideredDeviation, consider_parameters
from spinfilters.data.dataset import Dataset
from spinfilters.settings.run_settings import AUTO, Settings
from spinfilters.state.layout import StateLayout

STATED, PRIOR = "stated", "prior"


def considered_deviations(
    dataset: Dataset, settings: Settings, layout: StateLayout
) -> tuple[ConsideredDeviation, ...]:
    """Considered deviations of the sensors and the clock.

    Numbers that the state holds have none. Some may be zero.
    """
    found = []
    for name, parameter in consider_parameters().items():
        if (
            not parameter.concerns(dataset.log.sensors, dataset.inspector is not None)
            or parameter.block in layout.blocks
        ):
            continue
        stated = getattr(settings.calibration, name, AUTO)  # of a plug-in that came after the settings
        told = dataset.options.calibration.get(name) if stated == AUTO else float(stated)
        std = parameter.default if told is None else told
        found.append(ConsideredDeviation(parameter, std, PRIOR if told is None else STATED))
    return tuple(found)
