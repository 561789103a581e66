"""Our analyser beside StrikePy, pybounds and symident.

On the same systems: answers and seconds in one run.
    pip install StrikePy pybounds symident
    python -m experiments.benchmarks.observability_tools --out runs/peers

Every tool gets the expressions of our own process and sensors, translated from their instruction tapes, so nothing is typed twice.
Each runs in a process of its own that has imported it and analysed a small system before the clock starts; the median of several
runs is taken, except where a tool reaches its time limit. Tools that are not installed are left out.

Quaternions are four free numbers for the peers, so systems are taken whose rank does not depend on their norm: there the peers'
null space is the inertia's scale, as ours. pybounds gives singular values; those below 1e-6 of the largest are counted as null.
"""

import argparse
import contextlib
import io
import multiprocessing as mp
import re
import statistics
import sys
import types
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from queue import Empty
from typing import Any, Final, NamedTuple

import casadi as ca
import numpy as np

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.command_line import run_study
from observability import system as sensors
from observability.canonical_motions import CANONICAL_MOTIONS, point_of
from observability.certificate import certify
from observability.coordinates import MOMENTS, PrincipalChart, TensorChart
from observability.exact_numbers import as_floats
from observability.system import System
from observability.tape import Tape, evaluate
from spinfilters.io.output_files import make_folder, write_json

SYSTEMS: Final[dict[str, Callable[[], System]]] = {
    "gyro, principal moments": lambda: System(
        PrincipalChart(MOMENTS, False, False), [sensors.watching("gyro")]
    ),
    "gyro, inertia tensor": lambda: System(TensorChart(False, False), [sensors.watching("gyro")]),
    "attitude, inertia tensor": lambda: System(TensorChart(True, False), [sensors.watching("attitude")]),
    "pose, inertia tensor": lambda: System(TensorChart(), [sensors.watching("pose")]),
}
TOOLS: Final = ("ours", "symident", "pybounds", "StrikePy")
RUNS: Final = 5
SMALL: Final = 1e-6
"""Part of the largest singular value below which pybounds' are counted as null."""
SAMPLES, STEP = 20, 0.1
"""Of pybounds' simulation, s: two radians of the tumble."""
CAN_SAY: Final = """
|   | ours | symident | pybounds | StrikePy |
|---|---|---|---|---|
| rank in general position | exact | exact | float | symbolic |
| rank at a special motion (a pure spin) | exact | where the special values are known numbers; called a lower bound | float | no |
| null directions | residues, floats, names | closed forms | singular vectors | which variables |
| moved by a finite amount and simulated | yes | no | no | no |
| proof from both sides, or "open" | yes, at special motions too | in general position | no | no |
| known inputs | yes | yes | yes | yes |
| how well: Cramer-Rao bound | yes, process noise may be 0 | no | yes, process noise above 0 | no |
| models | CasADi expressions of the filters | formulas | Python functions | SymPy |
""".strip()


class ToolAnswer(NamedTuple):
    """Answer of one tool for one system.

    Null dimension, or None, with a reason, and its median seconds.
    """

    null_dimension: int | None
    seconds: float
    note: str = ""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, write ``observability.json`` where a folder is given."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--limit", type=float, default=60.0, help="seconds that a tool may take for a system")
    parser.add_argument("--out", type=Path, help="folder for observability.json")
    options = parser.parse_args(arguments)
    begin_benchmark("experiments.benchmarks.observability_tools")
    tools = [tool for tool in TOOLS if tool == "ours" or find_spec(tool) is not None]
    print(f"tools: {', '.join(tools)}; not installed: {', '.join(set(TOOLS) - set(tools)) or 'none'}")
    table = {name: {tool: limited(tool, name, options.limit) for tool in tools} for name in SYSTEMS}
    for name, answers in table.items():
        print(f"\n{name}")
        for tool, answer in answers.items():
            print(f"  {tool:<10}{_in_words(answer, answers['ours'])}")
    print(f"\n{CAN_SAY}")
    if options.out is not None:
        make_folder(options.out)
        document = {
            name: {tool: answer._asdict() for tool, answer in answers.items()}
            for name, answers in table.items()
        }
        write_json(options.out / "observability.json", document)


def _in_words(answer: ToolAnswer, ours: ToolAnswer) -> str:
    if answer.null_dimension is None:
        return f"no answer: {answer.note}"
    times = answer.seconds / ours.seconds
    return f"null dimension {answer.null_dimension}, {1e3 * answer.seconds:.1f} ms, {times:.1f} times ours {answer.note}"


def limited(tool: str, name: str, limit: float) -> ToolAnswer:
    """An answer from a process that is stopped at the limit."""
    context = mp.get_context("spawn")
    queue: Any = context.Queue()
    process = context.Process(target=_work, args=(tool, name, queue))
    process.start()
    try:
        return queue.get(timeout=limit)
    except Empty:
        return ToolAnswer(None, limit, f"stopped after {limit:g} s")
    finally:
        process.terminate()
        process.join()


def _work(tool: str, name: str, queue: Any) -> None:
    warnings.simplefilter("ignore")
    answer: Callable[[System], Callable[[], ToolAnswer]] = {
        "ours": _ours,
        "symident": _symident,
        "pybounds": _pybounds,
        "StrikePy": _strikepy,
    }[tool]
    try:
        answer(SYSTEMS["gyro, principal moments"]())()
        run = answer(SYSTEMS[name]())
        answers = [_timed(run) for _ in range(RUNS)]
    except Exception as error:
        queue.put(ToolAnswer(None, 0.0, f"{type(error).__name__}: {error}"))
        return
    queue.put(answers[0]._replace(seconds=statistics.median(each.seconds for each in answers)))


def _timed(run: Callable[[], ToolAnswer]) -> ToolAnswer:
    begin = now()
    answer = run()
    return answer._replace(seconds=now() - begin)


def _ours(system: System) -> Callable[[], ToolAnswer]:
    """Our answer with names, finite moves and proof, from a new expression."""
    point = point_of(system.chart, CANONICAL_MOTIONS[0])

    def run() -> ToolAnswer:
        """One run of the tool."""
        found = certify(System(system.chart, system.sensors), point)
        return ToolAnswer(found.null_dimension, 0.0, "" if found.certified else "open")

    return run


def _symident(system: System) -> Callable[[], ToolAnswer]:
    symident = import_module("symident")

    names, rates, outputs = formulas(system)
    odes = dict(zip(names, map(str, rates), strict=True))
    model = symident.Model(odes, {f"y{k}": str(output) for k, output in enumerate(outputs)})

    def run() -> ToolAnswer:
        """One run of the tool."""
        found = symident.detect(model)
        return ToolAnswer(int(found.dim) - int(found.rank), 0.0)

    return run


def _pybounds(system: System) -> Callable[[], ToolAnswer]:
    pybounds = import_module("pybounds")

    x, u = ca.SX.sym("x", system.chart.mean_dim), ca.SX.sym("u", 0)
    rate = ca.Function("rate", [x], [system.rate(x, u)])
    parameters = ca.SX(ca.DM(as_floats(system.sensors[0].parameters[0])))
    output = ca.Function("output", [x], [system.measured(system.sensors[0], x, parameters)])
    simulator = pybounds.Simulator(
        lambda X, _: ca.vertsplit(rate(ca.vertcat(*X))),
        lambda X, _: ca.vertsplit(output(ca.vertcat(*X))),
        dt=STEP,
        n=system.chart.mean_dim,
        m=1,
    )
    start = as_floats(point_of(system.chart, CANONICAL_MOTIONS[0]))

    def run() -> ToolAnswer:
        """One run of the tool."""
        matrix = pybounds.EmpiricalObservabilityMatrix(simulator, start, np.zeros((SAMPLES, 1))).O
        values = np.linalg.svd(np.asarray(matrix), compute_uv=False)
        return ToolAnswer(int((values < SMALL * values[0]).sum()), 0.0)

    return run


def _strikepy(system: System) -> Callable[[], ToolAnswer]:
    sympy = import_module("sympy")
    strike_goldd = import_module("StrikePy.strike_goldd").strike_goldd
    names, rates, outputs = formulas(system)
    options = types.ModuleType("StrikePy.custom_options.ours")
    options.__dict__.update(modelname="ours", checkObser=1, maxLietime=float("inf"), nnzDerU=[0], nnzDerW=[0])

    def run() -> ToolAnswer:
        """One run of the tool."""
        model = types.ModuleType("StrikePy.models.ours")  # it writes into the model it is given
        moving = [[sympy.Symbol(name)] for name, rate in zip(names, rates, strict=True) if rate != 0]
        constant = [[sympy.Symbol(name)] for name, rate in zip(names, rates, strict=True) if rate == 0]
        content = {
            "x": moving,
            "f": [[rate] for rate in rates if rate != 0],
            "h": [[output] for output in outputs],
            "p": constant,
            "u": [],
            "w": [],
        }
        model.__dict__.update(content, variables_locales=dict(content))
        sys.modules[options.__name__], sys.modules[model.__name__] = options, model
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            strike_goldd("ours")
        ranks = re.findall(r"[Rr]ank\D{0,40}?(\d+)", printed.getvalue())
        if not ranks:
            return ToolAnswer(None, 0.0, "printed no rank")
        return ToolAnswer(len(names) - int(ranks[-1]), 0.0)

    return run


def formulas(system: System) -> tuple[list[str], list[Any], list[Any]]:
    """SymPy expressions of a state's rates and first sensor.

    Names of the state's numbers, their rates and the sensor's value.
    """
    sympy = import_module("sympy")

    names = [f"{block.name}{k}" for block in system.chart.blocks for k in range(block.size)]
    x = [sympy.Symbol(name) for name in names]
    numbers = [sympy.Rational(part.numerator, part.denominator) for part in system.sensors[0].parameters[0]]
    return names, translated(system.motion, [x, []]), translated(system.outputs[0], [x, numbers])


def translated(tape: Tape, inputs: list[list[Any]]) -> list[Any]:
    """A tape in SymPy: its registers evaluated over symbols."""
    sympy = import_module("sympy")

    registers = evaluate(tape, [np.zeros((len(given), 1)) for given in inputs]).astype(object)[:, 0]
    for where, given in zip(tape.inputs, inputs, strict=True):
        registers[where] = given
    for register, value in tape.constants:
        registers[register] = sympy.Rational(value.numerator, value.denominator)
    for group in tape.groups:
        for out, left, right in zip(group.out, group.left, group.right, strict=True):
            registers[out] = _SYMPY[group.operation](registers[left], registers[right])
    return [sympy.smallest_batch(registers[register]) for register in tape.output]


_SYMPY: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "neg": lambda a, _: -a,
    "twice": lambda a, _: 2 * a,
    "mul": lambda a, b: a * b,
    "sq": lambda a, _: a * a,
    "div": lambda a, b: a / b,
    "inv": lambda a, _: 1 / a,
}

if __name__ == "__main__":
    run_study(main)
