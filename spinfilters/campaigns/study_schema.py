"""JSON Schema of a study file, made from the records that validate its tables."""

from dataclasses import fields
from typing import Any, Final, get_type_hints

from spinfilters.campaigns.study import BASE, FACTORS, LOG_UNIFORM, RECORDING, StudyFile
from spinfilters.settings.settings_schema import DIALECT, record_schema, settings_schema

DRAWN: Final[dict[str, Any]] = {
    "type": "object",
    "description": "A number that every seed draws, uniform in its logarithm between two limits.",
    "properties": {LOG_UNIFORM: {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}},
    "required": [LOG_UNIFORM],
    "additionalProperties": False,
}


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file; every factor's table holds levels, each with the keys of the factor."""
    hints = get_type_hints(StudyFile)
    tables = {each.name: record_schema(hints[each.name]) for each in fields(StudyFile)}
    levels = {"type": "array", "minItems": 1}
    settings = {key: value for key, value in settings_schema().items() if key != "$schema"}
    settings["properties"] = {k: v for k, v in settings["properties"].items() if k != "estimators"}
    definitions = settings.pop("$defs")
    properties: dict[str, Any] = {
        "study": tables.pop("study"),
        "factors": {
            "type": "object",
            "required": ["estimator"],
            "properties": dict.fromkeys((RECORDING, *FACTORS), levels) | {RECORDING: {}},
            "patternProperties": {rf"^({'|'.join(FACTORS)})\.": levels},
            "additionalProperties": False,
        },
    }
    for name, table in (*tables.items(), ("settings", settings)):
        definitions |= table.pop("$defs", {})
        if name not in ("settings", "belief"):
            held = table["properties"]
            table["properties"] = {key: _or_drawn(schema) for key, schema in held.items()}
        properties[name] = {
            "type": "object",
            "description": f"Levels of the factor {name}; the others begin from {BASE}.",
            "additionalProperties": table,
        }
    return {
        "$schema": DIALECT,
        "title": "Study of spinfilters",
        "type": "object",
        "required": ["study", "factors"],
        "properties": properties,
        "additionalProperties": False,
        "$defs": definitions,
    }


def _or_drawn(schema: dict[str, Any]) -> dict[str, Any]:
    """Schema of a key that every seed may draw; of a table, each of its numbers may be."""
    if isinstance(inner := schema.get("additionalProperties"), dict):
        return {**schema, "additionalProperties": {"anyOf": [inner, DRAWN]}}
    return {"anyOf": [schema, DRAWN]}
