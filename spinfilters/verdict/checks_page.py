"""The page of all checks, made from their list."""

import re
import sys
from collections.abc import Iterator

from spinfilters.io.output_files import write_or_print
from spinfilters.models.status import ALL, LABELS, QUANTITIES, Holds
from spinfilters.verdict.checks import CHECKS, Check
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_tests import KINDS

HEAD = """# All checks of the verdict

Look up the check that failed in a run: what it tests, how often it fails by chance, and what to do. An estimate is `ok` if none of
these checks fails. In `summary.json`, `checks` names the failed ones with their numbers, and `holds` says of each quantity whether
it is `ok`, `doubtful` or `not determined`. A quantity holds if it is determined and no failed check concerns it
([how](../theory/verdict.md#what-still-holds)). Words in italics are numbers of the finding.

A false alarm is a failure although nothing is wrong; its probability follows from the distribution of the test. Measured rates on
simulated recordings come from `python -m experiments.what_holds` (every check, mixed motions) and
`python -m experiments.honesty` (model errors, campaigns of right recordings).

This page is made from the code by `python -m spinfilters.verdict.checks_page docs/reference/checks.md`; a test compares the two.
"""
MODEL_ERRORS = """
## Errors of the models

`model-error` tests each of these on the smoothed motion. A finding has the name of the error, such as `model-error:drag`. Errors
that look alike are joined by `/`. Sizes are in the unit.

| name | sentence | unit | cure |
|---|---|---|---|
"""


def page() -> str:
    """The page as Markdown."""
    return HEAD + "".join(_section(each) for each in CHECKS) + MODEL_ERRORS + "".join(_error_rows())


def _section(check: Check) -> str:
    rows = {
        "test": check.asks,
        "computed from": str(check.needs),
        "false alarm": check.false_alarm,
        "sentence": _show_template(check.sentence),
        "cure": _show_template(check.cure),
        "about": _list_quantities(check),
        "order": "first; its consequences are stated without a cure" if check.is_cause else "",
    }
    lines = "".join(f"- **{name}**: {text}\n" for name, text in rows.items() if text)
    return f"\n## `{check.name}`\n\n{lines}"


def _list_quantities(check: Check) -> str:
    left = "not determined" if check.leaves is Holds.NOT_DETERMINED else "doubtful"
    if not check.about:
        return "no quantity, unless the finding names some"
    own = ", ".join(LABELS[name] for name in QUANTITIES if name in check.about)
    return f"{'all quantities' if check.about == ALL else own}, {left} then"


def _show_template(template: str) -> str:
    """A template with its numbers by name."""
    if template in ("{text}", "{cure}"):
        return "written for each finding"
    return re.sub(r"\{(\w+)[^}]*\}", r"*\1*", template).replace("{", "").replace("}", "")


def _error_rows() -> Iterator[str]:
    for each in (*table().values(), *KINDS):
        yield f"| `{each.name}` | {each.phrase} | {each.unit} | {_show_template(each.cure)} |\n"


def main(arguments: list[str]) -> int:
    """Write the page to a file, or print it."""
    return write_or_print(page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
