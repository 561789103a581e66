"""JSON Schema of summary.json, made from the table of metrics and the kinds of a verdict."""

from typing import Any, Final

from spinfilters.evaluation.metrics import ERRORS, metrics
from spinfilters.models.status import Verdict
from spinfilters.run.run_summary import SCHEMA
from spinfilters.settings.settings_schema import DIALECT

NUMBERS: Final[dict[str, Any]] = {"type": ["number", "null", "array", "object", "string", "boolean"]}
"""Of a metric: null is written for what is not finite or not known."""
TEXTS: Final[dict[str, Any]] = {"type": "array", "items": {"type": "string"}}


def summary_schema() -> dict[str, Any]:
    """JSON Schema of summary.json; new keys may be added to it, so that unknown ones are allowed."""
    tables = ("dataset", "process", "sensors", "conditions", "start")
    return {
        "$schema": DIALECT,
        "title": "summary.json of spinfilters",
        "type": "object",
        "required": ["schema", "dataset", "estimators"],
        "properties": {
            "schema": {"const": SCHEMA},
            **{name: {"type": ["object", "null"]} for name in tables},
            "estimators": {"type": "object", "additionalProperties": {"$ref": "#/$defs/estimator"}},
        },
        "$defs": {"estimator": _estimator(), "noise": _noise()},
    }


def _estimator() -> dict[str, Any]:
    """Verdict, metrics and noise of one estimator."""
    schema: dict[str, Any] = {
        "type": "object",
        "required": ["status", "reasons"],
        "properties": {
            "status": {"enum": [str(each) for each in Verdict]},
            "reasons": TEXTS,
            "holds": {"type": "object", "additionalProperties": {"type": "string"}},
            "noise": {"type": "object", "additionalProperties": {"$ref": "#/$defs/noise"}},
            ERRORS: {"type": ["object", "null"], "properties": {}},
        },
    }
    for metric in metrics():
        if metric.key and not metric.needs_truth:
            _place(schema, metric.key, _described(metric.label, metric.unit))
        elif metric.needs_truth:
            schema["properties"][ERRORS]["properties"][metric.leaf] = _described(metric.label, metric.unit)
    return schema


def _described(label: str, unit: str) -> dict[str, Any]:
    return {**NUMBERS, "description": f"{label} ({unit})" if unit else label}


def _place(schema: dict[str, Any], key: str, value: dict[str, Any]) -> None:
    """Put the schema of a value where its key with dots says."""
    *tables, leaf = key.split(".")
    for name in tables:
        schema = schema["properties"].setdefault(name, {"type": ["object", "null"], "properties": {}})
    schema["properties"].setdefault(leaf, value)


def _noise() -> dict[str, Any]:
    """One component of the noise."""
    return {
        "type": "object",
        "properties": {
            "value": {"type": ["number", "null"]},
            "std": {"type": ["number", "null"]},
            "source": {"type": "string"},
        },
    }
