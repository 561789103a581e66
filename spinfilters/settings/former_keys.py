"""Keys of settings files written before names were standardised."""

from collections.abc import Mapping
from typing import Any

from spinfilters.errors import InputError

FORMER_TABLES = {"start": "initialisation"}
FORMER_KEYS = {
    "initialisation": {"frames": "epochs"},
    "smoother": {"frames": "epochs", "kernel": "loss"},
    "robust": {"kernel": "loss"},
}


def with_present_keys(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with former names of tables and keys replaced.

    Raises
    ------
    InputError: a table or key under its former and its present name.
    """
    tables = _renamed(document, FORMER_TABLES, "")
    return {
        name: _renamed(table, FORMER_KEYS.get(name, {}), f"{name}.") if isinstance(table, Mapping) else table
        for name, table in tables.items()
    }


def _renamed(table: Mapping[str, Any], former: Mapping[str, str], prefix: str) -> dict[str, Any]:
    for old, new in former.items():
        if old in table and new in table:
            raise InputError(f"{prefix}{old} and {prefix}{new} are one setting; keep {prefix}{new}")
    return {former.get(key, key): value for key, value in table.items()}
