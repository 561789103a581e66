"""Items of the sources: each ends with a number and a word, is written as a whole, and is not made twice."""

import json
from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.reproduction.item import TWEDDLE, Agreement, ComparedNumber, Item, ItemResult
from spinfilters.reproduction.items import ITEMS, chosen_items
from spinfilters.reproduction.results import reproduce, write_pages

QUICK = [item for item in ITEMS if item.seconds <= 2.0]


@pytest.mark.parametrize("item", QUICK, ids=lambda item: item.name)
def test_a_quick_item_agrees_or_says_why_not(item: Item) -> None:
    outcome = item.make()
    assert outcome.rows
    assert outcome.figures or outcome.tables or len(outcome.rows) > 1


def test_names_are_unique_and_say_source_and_kind() -> None:
    names = [item.name for item in ITEMS]
    assert len(set(names)) == len(names)
    assert all(name.split("-")[0] in ("tweddle", "decoust") for name in names)


def test_rows_agree_within_the_printed_digits_only() -> None:
    assert ComparedNumber("rate", 2.204, printed=2.20, tolerance=0.005).agreement is Agreement.AGREES
    assert ComparedNumber("error", 1.0, printed=2.0, smaller_is_better=True).agreement is Agreement.BETTER
    assert (
        ComparedNumber("error", 3.0, printed=2.0, smaller_is_better=True, why="other data").agreement
        is Agreement.DIFFERS
    )
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("rate", 2.21, printed=2.20, tolerance=0.005)
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("rate", float("nan"), printed=2.20, tolerance=0.005)
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("surfaces", 3.0, expected=(4.0, float("inf")))
    with pytest.raises(InputError, match="what is printed"):
        ComparedNumber("rate", 2.21)


def item(make: object, name: str = "tweddle-table-1.1") -> Item:
    return Item(name, TWEDDLE, "Table", "a test", make)  # pyright: ignore[reportArgumentType]


def test_what_is_there_is_kept_and_made_again_on_demand(tmp_path: Path) -> None:
    made = []

    def make() -> ItemResult:
        made.append(1)
        return ItemResult(
            [ComparedNumber("rate", 1.0, printed=1.0)], tables={"course": [{"time": 0.5, "rate": 2}]}
        )

    one = item(make)
    assert not reproduce([one], tmp_path)[0].kept
    assert reproduce([one], tmp_path)[0].kept
    assert not reproduce([one], tmp_path, again=True)[0].kept
    assert len(made) == 2
    assert (tmp_path / one.name / "course.csv").read_text() == "time,rate\n0.5,2\n"
    assert "1 agrees, of 1 items" in (tmp_path / "reproduce.html").read_text()


def test_an_item_that_cannot_be_made_says_why_and_is_tried_again(tmp_path: Path) -> None:
    def fail() -> ItemResult:
        raise InputError("the scan is empty; give points")

    failed = reproduce([item(fail)], tmp_path)[0]
    assert failed.agreement == "failed"
    assert "the scan is empty" in (tmp_path / "reproduce.html").read_text()
    assert not reproduce([item(fail)], tmp_path)[0].kept


def test_damaged_results_are_made_again_or_refused(tmp_path: Path) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    place = tmp_path / one.name
    reproduce([one], tmp_path)
    (place / "own.txt").write_text("mine")
    assert reproduce([one], tmp_path)[0].kept
    with pytest.raises(InputError, match=r"own\.txt"):
        reproduce([one], tmp_path, again=True)
    (place / "own.txt").unlink()
    document = json.loads((place / "item.json").read_text())
    (place / "item.json").write_text(json.dumps(document | {"rows": 3}))
    with pytest.raises(InputError, match="changed since"):
        reproduce([one], tmp_path)


@pytest.mark.parametrize("changed", [{"rows": [3]}, {"pictures": [None]}, {"result": 1}, {"name": "other"}])
def test_items_that_somebody_changed_are_left_out_of_the_page(
    changed: dict[str, object], tmp_path: Path
) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    reproduce([one], tmp_path)
    path = tmp_path / one.name / "item.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    (tmp_path / "reproduce.html").unlink()
    write_pages(tmp_path)
    assert not (tmp_path / "reproduce.html").exists()


def test_names_choose_items_by_their_beginning() -> None:
    assert chosen_items(()) == ITEMS
    assert [each.name for each in chosen_items(("tweddle-table-1.1",))] == ["tweddle-table-1.1"]
    assert len(chosen_items(("tweddle-figure-2",))) >= 5
    with pytest.raises(InputError, match="reproduce list"):
        chosen_items(("tweddle-figure-99",))
