"""The page of all settings, made from the records that validate them."""

import sys
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Final, get_type_hints

from spinfilters.io.output_files import write_or_print
from spinfilters.settings.run_settings import Settings
from spinfilters.settings.setting_validation import wanted
from spinfilters.settings.settings_schema import field_words

HEAD: Final = """# All settings

Look up a setting here, with its default and range. A settings file is TOML. `compare --config FILE` reads one, `--set KEY=VALUE`
changes one key, and `./spinfilters.toml` is read if no other file is named ([more](../how-to/command-line.md#state-settings)).
A key that the file does not mention keeps its default. `"auto"` takes what the data set states.

`spinfilters schema settings` prints the same as a JSON Schema, with which editors complete and check a file.
`python -m spinfilters.settings.settings_page docs/reference/settings.md` makes this page from the code; a test compares the two.
"""


def page() -> str:
    """The page as Markdown."""
    hints, words = get_type_hints(Settings, include_extras=True), field_words(Settings)
    tables = [each for each in fields(Settings) if is_dataclass(hints[each.name])]
    own = [each for each in fields(Settings) if each not in tables]
    sections = [f"\n## Keys of no table\n\n{_table(own, hints, words)}"]
    for each in tables:
        kind = hints[each.name]
        rows = _table(list(fields(kind)), get_type_hints(kind, include_extras=True), field_words(kind))
        sections.append(f"\n## `[{each.name}]`\n\n{words[each.name]}\n\n{rows}")
    return HEAD + "".join(sections)


def _table(rows: list[Any], hints: dict[str, Any], words: dict[str, str]) -> str:
    lines = ["| key | default | what to give | what it is |", "|---|---|---|---|"]
    for each in rows:
        default = each.default if each.default_factory is MISSING else each.default_factory()
        cells = (f"`{each.name}`", f"`{_toml(default)}`", wanted(hints[each.name]), words.get(each.name, ""))
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """A default as a settings file would state it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else f"{value}"


def main(arguments: list[str]) -> int:
    """Write the page to a file, or print it."""
    return write_or_print(page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
