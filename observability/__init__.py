"""Observability analysis, proved exactly and said in words. See this folder's README."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from observability.model_analysis import ModelAnalysis, analyse, analyse_file
    from observability.model_bound import ModelBound, bound, empirical_information, gain_table

PUBLIC = {
    "ModelAnalysis": "model_analysis",
    "analyse": "model_analysis",
    "analyse_file": "model_analysis",
    "ModelBound": "model_bound",
    "bound": "model_bound",
    "empirical_information": "model_bound",
    "gain_table": "model_bound",
}
"""Public names and their modules."""

__all__ = [
    "ModelAnalysis",
    "ModelBound",
    "analyse",
    "analyse_file",
    "bound",
    "empirical_information",
    "gain_table",
]


def __getattr__(name: str) -> Any:
    """Public names, loaded when they are asked for."""
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"observability.{PUBLIC[name]}"), name)
