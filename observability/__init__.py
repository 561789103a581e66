"""Observability analysis, proved exactly and said in words. See this folder's README."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from observability.model_analysis import ModelAnalysis, analyse, analyse_file

__all__ = ["ModelAnalysis", "analyse", "analyse_file"]


def __getattr__(name: str) -> Any:
    """Public names, loaded when they are asked for."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from observability import model_analysis

    return getattr(model_analysis, name)
