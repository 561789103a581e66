"""Names of the field: words that have a standard term are no part of a name."""

import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
STANDARD = {
    "sighting": "observation",
    "sightings": "observations",
    "foretold": "predicted",
    "foretell": "predict",
    "newest": "latest",
    "tied": "has_landmarks",
    "judged": "with_verdict",
    "decrement": "predicted_reduction",
    "revived": "reinitialised",
    "revival": "landmark_reinitialisation",
    "grams": "information_blocks",
    "keeper": "checkpoint_store",
    "forgetful": "null_store",
    "perception": "tracks",
}
FILES = sorted(
    path for package in ("spinfilters", "observability") for path in (ROOT / package).rglob("*.py")
)


def words_of(text: str) -> set[str]:
    """The words that names of a source are made of."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return parts_of({token.string for token in tokens if token.type == tokenize.NAME})


def parts_of(names: set[str]) -> set[str]:
    """The words that names are made of."""
    return {word.lower() for name in names for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name)}


def standard_words(text: str) -> set[str]:
    """Words with a standard term in names of a source; without one in its whole text its names need not be found."""
    return (
        words_of(text) & set(STANDARD) if parts_of(set(re.findall(r"\w+", text))) & set(STANDARD) else set()
    )


def test_names_are_taken_apart() -> None:
    text = "class NewestSighting: at_rest = TIED"
    assert words_of(text) >= {"newest", "sighting", "at", "rest", "tied"}
    assert standard_words(text) == {"newest", "sighting", "tied"}


def test_names_use_the_standard_terms() -> None:
    found = {str(path.relative_to(ROOT)): standard_words(path.read_text(encoding="utf-8")) for path in FILES}
    instead = {path: {word: STANDARD[word] for word in words} for path, words in found.items()}
    assert {path: words for path, words in instead.items() if words} == {}


def test_modules_have_standard_names() -> None:
    parts = {
        word
        for path in FILES
        for part in path.relative_to(ROOT).with_suffix("").parts
        for word in part.split("_")
    }
    assert not parts & set(STANDARD)
