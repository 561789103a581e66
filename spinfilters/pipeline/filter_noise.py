"""Initial and final noise levels of adaptive filters."""

from collections.abc import Callable

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.filters.density_mean import raised_logarithm
from spinfilters.estimators.filters.noise_adaptation import NoiseScale
from spinfilters.estimators.identification.components import TORQUE_PSD, VarianceComponent
from spinfilters.pipeline.setup import Setup


def identified_scales(setup: Setup) -> dict[str, NoiseScale]:
    """Scales that the initialisation has identified, by source.

    The most probable level beside what the process and sensors are told, with the information 2 / var that it rests on. A
    sensor has one scale, and none where a part of its noise is stated.
    """
    found = {each.name: each for each in setup.identified}
    scales = {}
    for source, options in _sources(setup).items():
        if all(name in found for name in options):
            information = sum(2 / found[name].log_std ** 2 for name in options)
            share = found[options[0]].share
            raised = sum(
                raised_logarithm(found[name].log_std ** 2, share)
                for name in options
                if found[name].is_density
            )
            scales[source] = NoiseScale(-raised, information, share)
    return scales


def adapted_levels(setup: Setup, level: Callable[[str], NoiseScale]) -> tuple[VarianceComponent, ...]:
    """Noise levels after a filter's adaptation."""
    first, sources = identified_scales(setup), _sources(setup)
    levels = []
    for each in setup.identified:
        source = next((s for s, options in sources.items() if each.name in options and s in first), None)
        levels.append(each if source is None else _adapted(each, first[source], level(source)))
    return tuple(levels)


def _adapted(found: VarianceComponent, before: NoiseScale, after: NoiseScale) -> VarianceComponent:
    share = before.information / after.information
    return found.scaled(after.logarithm - before.logarithm, share**0.5)


def _sources(setup: Setup) -> dict[str, tuple[str, ...]]:
    """Options of every source of noise that may adapt."""
    sources: dict[str, tuple[str, ...]] = {
        f"process.{'torque' if name == TORQUE_PSD else 'force'}": (name,) for name in setup.sought.densities
    }
    for stream in setup.dataset.log.streams:
        options = [o.name for o in sensor_format(stream.sensor).noise if o.components is not None]
        if options and all(stream.sensor in setup.sought.options.get(name, ()) for name in options):
            sources[f"sensor.{stream.sensor}"] = tuple(options)
    return sources
