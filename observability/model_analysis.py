"""Observability of any system of a user's own equations: rank, names, proof, in words, JSON and HTML.

Of equations with max, min, abs or comparisons it also says under which conditions it holds: those of the point it was made at.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from fractions import Fraction
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

from observability.codistribution import ExactRank
from observability.discrete_rank import outputs_rank
from observability.generators import Generator, named_directions
from observability.invariant_manifold import known_numbers, restricted, staying
from observability.invariants import Invariant, InvariantSet, Reparametrisation, invariants, reparametrised
from observability.lie_derivatives import InvertedModel, ObservabilityMatrix, invert, observability_matrix
from observability.model import Model, model_of, with_norms
from observability.model_rank import THOUSANDTHS, ReachedModel, draw_point, projected, reached
from observability.null_vectors import RationalNullSpace, rational_null_space, symbolic_null_vectors
from observability.other_solutions import (
    NOT_SEARCHED,
    DiscreteSearch,
    OtherSolutions,
    SolutionFamily,
    discrete_symmetries,
    other_solutions,
)
from observability.real_rank import RealRank, real_rank
from observability.tape import NAMES, PIECEWISE
from observability.written_formulas import written
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import printable, read_toml


class ModelProof(StrEnum):
    """Why the rank of a model is known."""

    FULL = "the exact rank is full"
    GENERATORS = "the exact rank and the generators, which hold for finite moves, add up to all unknowns"
    GENERIC = "at a generic point the first order of derivatives that adds nothing is the last"
    MANIFOLD = "at a generic point of an invariant manifold the first order of derivatives that adds nothing is the last"
    INVERSION = (
        "with the unknown inputs solved for, the first order of derivatives that adds nothing is the last"
    )
    STEPS = "at a generic point of an invertible step the first step that adds nothing is the last"
    OPEN = "open"


@dataclass(frozen=True)
class ModelAnalysis:
    """Observability of a model; printed, it says what the outputs determine and what not.

    Attributes
    ----------
    model : Model
        What was asked.
    core : Model
        The same without states whose known initial values stay as they are; norms of unit vectors are outputs of it, which
        are known.
    exact : ExactRank
        Of the unknowns that outputs depend on.
    unreached : tuple[str, ...]
        Unknowns that no output depends on.
    """

    model: Model
    core: Model
    exact: ExactRank
    unreached: tuple[str, ...]

    @property
    def dimension(self) -> int:
        """Unknowns: parameters, states at time 0 and unknown inputs at time 0, one less for each unit vector."""
        return len(self.model.unknowns) - len(self.model.unit_vectors)

    @property
    def rank(self) -> int:
        """Dimensions that the outputs and all their derivatives determine."""
        return self.exact.rank - len(self.model.unit_vectors)

    @property
    def null_dimension(self) -> int:
        """Directions that they do not."""
        return self.dimension - self.rank

    @property
    def order(self) -> int:
        """Order of the derivatives that reaches the rank."""
        return self.exact.order

    @cached_property
    def observable(self) -> dict[str, bool]:
        """Of every unknown, whether the outputs determine it locally (at a special point: to first order)."""
        moved = {name for name, row in zip(self.exact.names, self.exact.null_space, strict=True) if row.any()}
        return {name: name not in moved and name not in self.unreached for name in self.model.unknowns}

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Unknowns that the outputs do not determine."""
        return tuple(name for name, seen in self.observable.items() if not seen)

    @cached_property
    def generic_rank(self) -> int | None:
        """Rank at generic points, where a special one was asked for."""
        if not self.model.point:
            return None
        generic = outputs_rank(reached(with_norms(replace(self.model, point={}))))
        return generic.rank - len(self.model.unit_vectors)

    @property
    def unidentifiable(self) -> set[str]:
        """The same as a set."""
        return set(self.unobservable)

    @cached_property
    def inverted(self) -> InvertedModel | None:
        """The model with its unknown inputs solved for, where there are some and this is possible."""
        if (
            self.core.discrete
            or not self.core.unknown_inputs
            or self.core.known_initial_values
            or self.core.point
        ):
            return None
        return invert(self.core)

    @property
    def generators(self) -> list[dict[str, str]]:
        """`symmetries` as formulas: the change of every unknown that moves."""
        return [each.components for each in self.symmetries]

    @cached_property
    def symmetries(self) -> tuple[Generator, ...]:
        """Fields of the unknowns that no output notices, as closed forms; found when they are asked for.

        At a special point these are the generic ones, and those of the states that stay at their values.
        """
        if not self.null_dimension or self.core.discrete:
            return ()
        return tuple(named_directions(self.core))

    @cached_property
    def invariants(self) -> InvariantSet:
        """Functions of unobservable unknowns that are determined, such as J2/J1.

        Where some directions lack a generator, those invariants are left out that these directions change.
        """
        found = self._kept_by_generators
        if len(self.symmetries) == self.null_dimension:
            return found
        kept = tuple(each for each in found.found if self._is_determined(each))
        return InvariantSet(kept, len(kept) == len(self.unobservable) - self.null_dimension)

    def _is_determined(self, invariant: Invariant) -> bool:
        """Whether an invariant as one more output determines nothing more."""
        outputs = {**self.core.outputs, "the invariant": invariant.expression(self.core.symbols)}
        try:
            return outputs_rank(reached(replace(self.core, outputs=outputs))).rank == self.exact.rank
        except InputError:
            return False

    @cached_property
    def _kept_by_generators(self) -> InvariantSet:
        """Functions of unknowns that none of the generators found changes."""
        fixed = self.reparametrisation.fixed if self.reparametrisation else ()
        return invariants(self.symmetries, self.model.unknowns, tuple(fixed))

    @cached_property
    def reparametrisation(self) -> Reparametrisation | None:
        """A minimal model with the same outputs, where all directions are scalings and translations."""
        known = len(self.symmetries) == self.null_dimension
        return reparametrised(self.core, self.symmetries) if known else None

    @cached_property
    def null_vectors(self) -> RationalNullSpace | None:
        """Null vectors at a point of small integers; None with functions that have no rational values there."""
        return None if self.core.discrete else rational_null_space(reached(self.core), self.exact)

    @cached_property
    def symbolic_null_vectors(self) -> list[dict[str, str]]:
        """Null vectors as formulas."""
        if self.core.discrete:
            return []
        return symbolic_null_vectors(self.core, self.exact, self.symmetries, reached(self.core))

    def observability_matrix(self, orders: int | None = None) -> ObservabilityMatrix:
        """Lie derivatives and their gradients as formulas, of as many orders as reach the rank unless it is said.

        Raises
        ------
        InputError
            In discrete time, and where a formula becomes too long.
        """
        if self.core.discrete:
            raise InputError(f"{self.model.name}: Lie derivatives are of models in continuous time")
        return observability_matrix(self.core, self.order + 1 if orders is None else orders)

    @cached_property
    def other_solutions(self) -> DiscreteSearch:
        """Other solutions: unknowns mirrored or exchanged."""
        if self.core.discrete:
            return DiscreteSearch((), False)
        whole = len(self.symmetries) == self.null_dimension
        family = SolutionFamily(
            self.symmetries, self._kept_by_generators, frozenset(self.unobservable), whole
        )
        return discrete_symmetries(reached(self.core), family)

    @cached_property
    def isolated_solutions(self) -> OtherSolutions:
        """Other values of the unknowns with the same outputs, searched for at a random point; takes some seconds.

        Where not all unknowns are observable, they are those of the smallest model with the same outputs (`reparametrisation`).
        """
        if self.core.discrete:
            return NOT_SEARCHED
        if self.null_dimension == 0:
            return other_solutions(reached(self.core), self.exact)
        if self.reparametrisation is None:
            return NOT_SEARCHED
        part = reached(self.reparametrisation.model)
        return other_solutions(part, outputs_rank(part))

    @cached_property
    def real_rank(self) -> RealRank:
        """What ranks at real points say of the exact one."""
        return real_rank(reached(self.core), self.exact)

    @cached_property
    def branches(self) -> list[str]:
        """Inequalities that the answer is limited to, with max, min, abs or comparisons in the equations."""
        return [] if self.core.discrete else branch_conditions(reached(self.core))

    @cached_property
    def proof(self) -> ModelProof:
        """Why the rank is known."""
        if self.real_rank is not RealRank.SAME:
            return ModelProof.OPEN
        if self.null_dimension == 0:
            return ModelProof.FULL
        if self.exact.complete:
            if self.core.discrete:
                return ModelProof.STEPS
            return ModelProof.GENERIC if self.core.is_generic else ModelProof.MANIFOLD
        if self.inverted is not None and self.inverted.rank == self.exact.rank:
            return ModelProof.INVERSION
        known = len(self.symmetries) == self.null_dimension
        return ModelProof.GENERATORS if known else ModelProof.OPEN

    @property
    def certified(self) -> bool:
        """Whether the rank is known from below and above."""
        return self.proof is not ModelProof.OPEN

    @property
    def sentences(self) -> list[str]:
        """The whole text."""
        bound = "at most" if self.real_rank is RealRank.LOWER else "at least"
        verb = "have" if self.certified else f"have {bound}"
        order = (
            f"by step {self.order}" if self.model.discrete else f"with derivatives up to order {self.order}"
        )
        lines = [
            f"{self.model.name}: of {self.dimension} unknowns the outputs {verb} rank {self.rank}"
            + (f", reached {order}." if self.order else ".")
        ]
        seen = [name for name, each in self.observable.items() if each]
        title = "Observable at most" if self.real_rank is RealRank.LOWER else "Observable"
        lines.append(f"{title}: {', '.join(seen) or 'none'}.")
        if self.unobservable:
            count = self.null_dimension
            lines.append(
                f"Not observable: {', '.join(self.unobservable)} ({count} direction{'s' if count > 1 else ''})."
            )
        if self.unreached:
            lines.append(f"No output depends on {', '.join(self.unreached)}.")
        lines += [f"No output notices {each} ({each.kind})." for each in self.symmetries]
        if self.invariants.found:
            others = "" if self.invariants.complete else ", among others"
            lines.append(f"Determined of them{others}: {self.invariants}.")
        listed = {str(each) for each in self.invariants.found}
        for group in self.model.unit_vectors:
            square = " + ".join(f"{name}**2" for name in group)
            if square not in listed and not set(group).isdisjoint(self.unobservable):
                lines.append(f"Known beforehand of {', '.join(group)}: the norm 1.")
        if self.reparametrisation is not None:
            lines.append(f"{self.reparametrisation}.")
        unnamed = self.null_dimension - len(self.symmetries)
        if unnamed:
            words = f"{unnamed} direction{'s' if unnamed > 1 else ''}"
            lines.append(f"{words}{self._why_unnamed}")
        if unnamed and self.inverted is not None and self.inverted.compensated:
            lines.append(
                f"Any change of {', '.join(self.inverted.compensated)} goes unnoticed if "
                f"{', '.join(self.core.unknown_inputs)} changes along."
            )
        if self.branches:
            lines.append(
                f"All this holds where {' and '.join(self.branches)}; elsewhere max, min, abs or a comparison has another branch, "
                "which may determine other unknowns: give a point there to see."
            )
        lines.append(f"Proof: {self._proof_in_words()}.")
        lines += [each.sentence for each in self.other_solutions.found]
        if self.other_solutions.complete:
            lines.append(
                "Local, except for mirrored and exchanged unknowns: other isolated solutions are not searched."
            )
        else:
            lines.append("Local only: isolated other solutions are not looked for.")
        if self.generic_rank is not None and self.generic_rank > self.rank:
            lines.append(f"This point is special: generic points nearby have rank {self.generic_rank}.")
        return lines

    @property
    def _why_unnamed(self) -> str:
        """End of the sentence on directions without a generator."""
        if self.core.discrete:
            return (
                ", shown by the unknowns that move: generators and null vectors are not computed in discrete time, since they are "
                "searched as fields of a continuous motion."
            )
        words = " for which no generator was found up to degree 2."
        if not self._special_words:
            return words
        return (
            f"{words} A generator holds along the whole motion; with {self._special_words} a direction may go unnoticed "
            "at time 0 alone."
        )

    @property
    def _special_words(self) -> str:
        """Reasons for which the point is not in general position, in words; empty where it is."""
        reasons = [
            ("a special point", self.model.point),
            ("known initial values", self.model.known_initial_values),
            ("unknown inputs", self.model.unknown_inputs),
        ]
        return " and ".join(name for name, given in reasons if given)

    def _proof_in_words(self) -> str:
        if self.proof is not ModelProof.OPEN:
            return self.proof.value
        if self.real_rank is not RealRank.SAME:
            return f"open: {self.real_rank.value}"
        words = self._special_words
        if self.core.discrete:
            where = f" with {words}" if words else ", where a step forgets what was before,"
            return f"open: the exact rank is a lower bound; in discrete time{where} no step is known to be the last"
        return (
            f"open: the exact rank is a lower bound; with {words} no order of derivatives is known to be the last "
            f"({len(self.exact.names) + 2 + len(self.model.states)} were taken)"
        )

    def __str__(self) -> str:
        """The sentences, one a line."""
        return "\n".join(self.sentences)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{'observable' if seen else 'not observable'}</td></tr>"
            for name, seen in self.observable.items()
        )
        text = "".join(f"<p>{escape(line)}</p>" for line in self.sentences)
        return f"{text}<table><tr><th>unknown</th><th></th></tr>{rows}</table>"

    def symbols_in_words(self) -> str:
        """Null vectors in rationals and as formulas, then Lie derivatives with their gradients.

        Raises
        ------
        InputError
            Where a formula becomes too long.
        """
        lines = []
        if self.null_vectors is not None and self.null_vectors.vectors:
            lines += ["Null vectors.", str(self.null_vectors)]
        for each in self.symbolic_null_vectors:
            lines.append("Null vector: " + ", ".join(f"{name} {text}" for name, text in each.items()) + ".")
        return "\n".join([*lines, "Lie derivatives of the outputs.", str(self.observability_matrix())])

    def document(self) -> dict[str, Any]:
        """The analysis for JSON."""
        return {
            "model": self.model.name,
            "unknowns": list(self.model.unknowns),
            "rank": self.rank,
            "dimension": self.dimension,
            "order": self.order,
            "observable": self.observable,
            "not_reached": list(self.unreached),
            "generators": [each.components for each in self.symmetries],
            "null_vectors": self.null_vectors.document() if self.null_vectors else None,
            "symbolic_null_vectors": self.symbolic_null_vectors,
            "invariants": [str(each) for each in self.invariants.found],
            "invariants_complete": self.invariants.complete,
            "reparametrisation": self.reparametrisation.document() if self.reparametrisation else None,
            "other_solutions": [str(each) for each in self.other_solutions.found],
            "other_solutions_complete": self.other_solutions.complete,
            "generic_rank": self.generic_rank,
            "holds_where": self.branches,
            "certified": self.certified,
            "proof": self._proof_in_words(),
            "text": self.sentences,
        }


def analyse(f: Any, h: Any = None, x: Any = None, **roles: Any) -> ModelAnalysis:
    """Observability of x' = f, y = h: what the outputs determine of states, parameters and unknown inputs.

    Parameters
    ----------
    f : Mapping, casadi.SX or casadi.Function
        A dictionary of everything as a TOML file has it (`model_of_text`), formulas of the rates by state, or the rates of all
        states as expressions.
    h : Mapping, casadi.SX or casadi.Function
        Outputs: formulas by name where `f` is formulas by state, else expressions.
    x : casadi.SX
        States, with expressions.
    **roles : Any
        ``parameters``, ``inputs``, ``unknown_inputs``, ``known_constants`` as symbols, or names where `f` and `h` are formulas;
        ``known_initial_values`` and ``at``, values by name; ``unit_vectors``, a list of vectors of states whose norm is 1;
        ``name``. With one dictionary of everything only ``at`` and ``name``.

    Raises
    ------
    InputError
        One line with the name and the cure.

    Examples
    --------
    >>> import casadi as ca
    >>> from observability import analyse
    >>> x, k = ca.SX.sym("x", 2), ca.SX.sym("k")
    >>> print(analyse(ca.vertcat(x[1], -k * x[0]), x[0], x, parameters=k))
    the system: of 3 unknowns the outputs have rank 3, reached with derivatives up to order 2.
    Observable: k, x_0, x_1.
    Proof: the exact rank is full.
    Local, except for mirrored and exchanged unknowns: other isolated solutions are not searched.

    The same from formulas:

    >>> analyse({"x": "v", "v": "-k*x"}, {"y": "x"}, parameters=["k"]).rank
    3
    """
    return analysis_of(model_of(f, h, x, **roles))


def analysis_of(model: Model) -> ModelAnalysis:
    """The analysis of a model."""
    still = {} if model.discrete else staying(model, known_numbers(model))
    core = with_norms(restricted(model, still) if still else model)
    part = reached(core)
    unreached = tuple(name for name in model.unknowns if name not in part.unknowns)
    return ModelAnalysis(model, core, outputs_rank(part), unreached)


def analyse_file(path: str | Path) -> ModelAnalysis:
    """The analysis of a TOML file with a model.

    Raises
    ------
    InputError
        For a file that cannot be read or holds no model, in one line with its name.
    """
    document, name = read_model(Path(path)), printable(Path(path).name)
    try:
        return analyse(document, name=name)
    except InputError as error:
        raise error if name in str(error) else InputError(f"{name}: {error}") from None


def read_model(path: Path) -> Mapping[str, Any]:
    """The document of a model's TOML file."""
    if path.suffix != ".toml":
        raise InputError(
            f"{path}: a model is read from a TOML file, in which nothing is executed; write it as {path.stem}.toml, "
            "run a Python program of yours with --execute, or call observability.analyse in Python"
        )
    return read_toml(path)


LONGEST_CONDITION: Final = 80
"""Characters of a side of a condition that is printed."""
COMPARISONS: Final = {"fmax", "fmin", "lt", "le"}


def branch_conditions(part: ReachedModel) -> list[str]:
    """Inequalities such as "a > b" that hold at the point of an exact rank, one for each place where branches meet."""
    if PIECEWISE.isdisjoint(part.tape.operations):
        return []
    sides = list(_sides(part.rows))
    if not sides:
        return []
    differences = ca.Function("differences", part.arguments, [ca.vertcat(*[a - b for a, b in sides])])
    values = np.array(differences(*_point(part))).ravel()
    texts = [
        f"{_text(a)} {'>' if value > 0 else '<'} {_text(b)}"
        for (a, b), value in zip(sides, values, strict=True)
    ]
    return list(dict.fromkeys(texts))


def _sides(rows: Sequence[ca.SX]) -> Iterator[tuple[ca.SX, ca.SX]]:
    """Both sides of every place where branches meet."""
    waiting, seen = [row[k] for row in map(ca.SX, rows) for k in range(row.numel())], set()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.is_leaf():
            continue
        operands = [node.dep(k) for k in range(node.n_dep())]
        operation = NAMES[node.op()]
        if operation in COMPARISONS:
            yield operands[0], operands[1]
        elif operation == "fabs":
            yield operands[0], ca.SX(0)
        waiting += operands


def _point(part: ReachedModel) -> list[list[float]]:
    """The point that the exact rank was found at, as floats."""
    point = draw_point(part, np.random.default_rng(0))
    prime, given, found = point.field.prime, part.model.point, []
    for names, values in zip(part.groups, point.values, strict=True):
        numbers = values.p[:, 0].tolist()
        vectors = part.drawn_unit_vectors(names)
        for where in vectors:  # u = x / (1 + x_last), as drawn
            over = pow(1 + numbers[where[-1]], -1, prime)
            for k in where[:-1]:
                numbers[k] = numbers[k] * over % prime
        floats = np.array([float(Fraction(p * THOUSANDTHS % prime, THOUSANDTHS)) for p in numbers])
        for where in vectors:
            floats[where] = projected(floats[where[:-1], np.newaxis])[:, 0]
        pairs = zip(names, floats.tolist(), strict=True)
        found.append([float(given[name]) if name in given else value for name, value in pairs])
    return found


def _text(expression: ca.SX) -> str:
    try:
        text = written(expression)
    except InputError:
        text = str(expression)
    return text if len(text) <= LONGEST_CONDITION else f"{text[:LONGEST_CONDITION]}..."
