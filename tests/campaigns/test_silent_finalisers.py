"""Complaints of destroyed objects during a campaign: those of Dask are dropped, all others are not."""

import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from spinfilters.campaigns import dask_cluster


@pytest.mark.parametrize(
    ("module", "count"), [("distributed.client", 0), ("asyncio.base_events", 0), ("mine", 1), (None, 1)]
)
def test_only_complaints_of_dask_are_dropped(
    module: str | None, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []
    before: Callable[[Any], None] = told.append
    monkeypatch.setattr(sys, "unraisablehook", before)
    destroyed = None if module is None else SimpleNamespace(__module__=module)
    with dask_cluster.silent_dask():
        sys.unraisablehook(SimpleNamespace(object=destroyed))  # pyright: ignore[reportArgumentType]
    assert len(told) == count
    assert sys.unraisablehook is before
