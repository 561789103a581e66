"""Many hostile inputs one after another, and the report: how many, how long, and how to repeat what went wrong."""

import argparse
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from .case import Case
from .originals import make_originals
from .trial import Outcome, made, tried


def campaign(module: str, cases: Sequence[Case], options: argparse.Namespace) -> int:
    """Try all cases, or those whose names hold ``options.only``; print every violation and the counts.

    Returns
    -------
    The exit code: 1 where there was a violation.
    """
    chosen = [case for case in cases if options.only is None or options.only in case.name]
    with TemporaryDirectory(prefix="hostile-") as scratch:
        originals = Path(scratch) / "originals"
        make_originals(originals)
        if options.keep is not None:
            return _keep(chosen, originals, Path(options.keep))
        outcomes = _outcomes(chosen, originals, Path(scratch), _reporter(module, options))
    _print_counts(outcomes)
    return 1 if any(outcome.violations for _, outcome in outcomes) else 0


def parser(description: str) -> argparse.ArgumentParser:
    """The options that every campaign has."""
    made_parser = argparse.ArgumentParser(description=description)
    made_parser.add_argument("--only", metavar="TEXT", help="cases whose name holds this")
    made_parser.add_argument(
        "--keep", metavar="FOLDER", help="make the inputs there, print their commands, run nothing"
    )
    made_parser.add_argument("--verbose", action="store_true", help="a line for every case")
    return made_parser


def _outcomes(
    cases: Iterable[Case], originals: Path, scratch: Path, report: Callable[[Case, Outcome], None]
) -> list[tuple[Case, Outcome]]:
    found = []
    for case in cases:
        place = scratch / "case"
        outcome = tried(case, originals, place)
        shutil.rmtree(place)
        report(case, outcome)
        found.append((case, outcome))
    return found


def _reporter(module: str, options: argparse.Namespace) -> Callable[[Case, Outcome], None]:
    seed = f" --seed {options.seed}" if "seed" in options else ""

    def report(case: Case, outcome: Outcome) -> None:
        if options.verbose:
            print(
                f"{outcome.code} {outcome.seconds:5.1f} s {case.name!r} {outcome.said.strip()[-160:]!r}",
                flush=True,
            )
        for violation in outcome.violations:
            print(f"VIOLATION {case.name}: {violation}")
            print(f"    again: python -m {module}{seed} --only {case.name!r} --keep FOLDER", flush=True)

    return report


def _print_counts(outcomes: Sequence[tuple[Case, Outcome]]) -> None:
    codes = Counter(outcome.code for _, outcome in outcomes)
    wrong = sum(bool(outcome.violations) for _, outcome in outcomes)
    slowest = max(outcomes, key=lambda pair: pair[1].seconds)
    largest = max(outcomes, key=lambda pair: pair[1].memory_mb)
    print(f"{len(outcomes)} inputs: {codes[2]} refused, {codes[0]} run, {wrong} with violations")
    print(f"slowest {slowest[1].seconds:.1f} s: {slowest[0].name}")
    print(f"largest {largest[1].memory_mb:.0f} MB: {largest[0].name}")


def _keep(cases: Iterable[Case], originals: Path, folder: Path) -> int:
    for number, case in enumerate(cases):
        place = folder / f"{number:03d}"
        place.mkdir(parents=True)
        made(case, originals, place)
        words = " ".join(repr(word) for word in case.command(place))
        print(f"{case.name}:\n    spinfilters {words}", file=sys.stdout)
    return 0
