"""State blocks: one object each, found where they are defined, and asked instead of their letters."""

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.models.state_blocks import BLOCKS, DRAG, GYRO_BIAS, ErrorChart, StateBlock, table
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

PACKAGE = Path(spinfilters.__file__).parent
BY_LETTER = re.compile(r"""["'][a-z]{1,2}["'] (not )?in [\w.]*(blocks|layout)\b|\bblock (==|in [({]) ?["']""")


def test_blocks_stand_in_the_order_of_their_ranks() -> None:
    assert "".join(BLOCKS) == "tavwcsdbfmklh"
    assert tuple("tavwcs") == FULL_BLOCKS
    assert tuple("aws") == ROTATION_BLOCKS


@pytest.mark.parametrize("change", [{"name": "b", "rank": 99}, {"name": "z", "rank": GYRO_BIAS.rank}])
def test_two_blocks_of_one_name_or_rank_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"state blocks share the (name|rank)"):
        table(iter([GYRO_BIAS, replace(DRAG, **change)]))


@pytest.mark.parametrize("block", BLOCKS.values(), ids=lambda block: block.name)
def test_the_origin_of_a_block_at_no_error_is_the_origin(block: StateBlock) -> None:
    origin, none = ca.DM(block.origin), ca.DM.zeros(block.dimension)
    np.testing.assert_allclose(
        ca.DM(block.chart.retract(origin, none)).full()[:, 0], block.origin, atol=1e-15
    )
    for local in (block.chart.local, block.chart.near_local):
        np.testing.assert_allclose(ca.DM(local(origin, origin)).full(), 0.0, atol=1e-15)


@pytest.mark.parametrize("block", BLOCKS.values(), ids=lambda block: block.name)
def test_the_parameters_of_the_rotation_are_as_many_as_a_block_says(block: StateBlock) -> None:
    assert (
        block.rotation is None
        or block.rotation.of(ca.SX.sym("x", block.mean_size)).numel() == block.rotation.count
    )


def test_a_layout_tells_constant_from_moving_and_curved_from_additive_blocks() -> None:
    layout = StateLayout(tuple(BLOCKS))
    names = {
        which: "".join(block.name for block in getattr(layout, which))
        for which in ("constant", "moving", "curved")
    }
    assert names == {"constant": "csdbfmklh", "moving": "tavw", "curved": "as"}
    point = np.zeros(layout.mean_dim)
    point[layout.constant_indices] = 1.0
    assert all(point[layout.mean_slice(block.name)].all() == block.constant for block in layout.members)


def test_a_layout_without_translation_keeps_what_a_gyro_can_see() -> None:
    layout = StateLayout(FULL_BLOCKS).joined(GYRO_BIAS, DRAG)
    assert layout.blocks == (*FULL_BLOCKS, "d", "b")
    assert layout.without_translation.blocks == (*ROTATION_BLOCKS, "d", "b")
    assert layout.translates
    assert not layout.without_translation.translates


def test_every_component_of_an_error_belongs_to_the_block_that_holds_it() -> None:
    layout = StateLayout(tuple(BLOCKS))
    owners = [layout.block_of(k).name for k in range(layout.error_dim)]
    assert owners == [block.name for block in layout.members for _ in range(block.dimension)]


def test_a_block_of_plain_numbers_needs_no_chart_of_its_own() -> None:
    assert GYRO_BIAS.chart == ErrorChart()
    assert GYRO_BIAS.origin == (0.0, 0.0, 0.0)


def test_no_module_asks_for_a_block_by_its_letter() -> None:
    found = [
        f"{path.relative_to(PACKAGE)}: {line.strip()}"
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if BY_LETTER.search(line)
    ]
    assert not found


def test_the_how_to_page_shows_the_gyro_bias_as_it_is() -> None:
    page = PACKAGE.parent / "docs" / "how-to" / "add-a-state-block.md"
    if not page.exists():
        pytest.skip("the package is installed without its pages")
    text = page.read_text(encoding="utf-8")
    blocks = (PACKAGE / "models" / "state_blocks.py").read_text(encoding="utf-8")
    entry = blocks[blocks.index("GYRO_BIAS: Final") :].split("\n\n")[0]
    assert entry in text
    assert len(text.splitlines()) <= 50
