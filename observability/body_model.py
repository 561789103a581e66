"""A body in a chart with its sensors as a model: the built-in analysis in the terms of any other system."""

import casadi as ca

from observability.coordinates import is_attitude
from observability.exact_numbers import Rationals
from observability.model import Model
from observability.system import System


def model_of_system(system: System, point: Rationals | None = None, name: str = "the body") -> Model:
    """The model of a body: its chart's rates are f, its sensors' values h, unknown landmarks parameters, quaternions unit vectors.

    Parameters
    ----------
    system : System
        Chart, sensors and known inputs.
    point : Rationals, optional
        Exact numbers of the chart (`Chart.point`), where a special motion is asked for; landmarks are then those of the sensors.
    """
    chart = system.chart
    numbers = [_numbers_of(block.name, block.size) for block in chart.blocks]
    states = tuple(each for group in numbers for each in group)
    inputs = tuple(str(each.value).replace(" ", "_") for each in system.inputs)
    x, u = (ca.vertcat(ca.SX(0, 1), *[ca.SX.sym(each) for each in group]) for group in (states, inputs))
    symbols = {each: x[k] for k, each in enumerate(states)} | {each: u[k] for k, each in enumerate(inputs)}
    parameters = tuple(each.replace(" ", "_") for each in system.names[chart.error_dim :])
    symbols |= {each: ca.SX.sym(each) for each in parameters}
    outputs: dict[str, ca.SX] = {}
    values: dict[str, object] = {}
    own = iter(parameters)
    for index, sensor in enumerate(system.sensors):
        for item, given in enumerate(sensor.parameters):
            names = [next(own) for _ in range(sensor.unknown)]
            values |= dict(zip(names, given, strict=False))
            known = [ca.SX(float(number)) for number in given[sensor.unknown :]]
            value = ca.SX(system.measured(sensor, x, ca.vertcat(*[symbols[each] for each in names], *known)))
            outputs |= {f"y{index + 1}_{item + 1}_{k + 1}": value[k] for k in range(value.numel())}
    rate = ca.densify(ca.SX(system.rate(x, u)))
    special = {} if point is None else {**dict(zip(states, point, strict=True)), **values}
    return Model(
        states,
        parameters,
        inputs,
        (),
        (),
        symbols=symbols,
        rates={each: rate[k] for k, each in enumerate(states)},
        outputs=outputs,
        point=special,
        name=name,
        unit_vectors=tuple(
            group for group, block in zip(numbers, chart.blocks, strict=True) if is_attitude(block)
        ),
    )


def _numbers_of(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}_{k + 1}" for k in range(size))
