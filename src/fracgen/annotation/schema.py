"""The JSON schema of a condition file, as `Condition` gives it.

`python -m fracgen.annotation.schema docs/condition.schema.json` writes it.
"""

import json
import sys
from pathlib import Path
from typing import Any

from fracsim.scene.condition import OPTIONAL, Condition
from fracsim.scene.knob import Knob, describe


def schema() -> dict[str, Any]:
    """The schema, in the words of JSON Schema 2020-12; that crit is greater than onset it cannot say."""
    known = list(describe(Condition))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Condition",
        "description": "One pull on one object in one picture. Positions are in picture widths and heights from the "
        "top left corner. crit must be greater than onset.",
        "type": "object",
        "properties": {name: _property(default, rule) for name, default, rule in known},
        "required": [name for name, _, _ in known if name not in OPTIONAL],
        "additionalProperties": False,
    }


def _property(default: Any, rule: Knob) -> dict[str, Any]:
    """The schema of a field."""
    about = {"description": f"{rule.doc} [{rule.unit}]" if rule.unit else rule.doc, "default": default}
    if isinstance(default, list):
        size = {"minItems": len(default), "maxItems": len(default)}
        return {**about, "type": "array", "items": _number(rule), **size}
    if isinstance(default, str):
        return {**about, "type": "string", **({"enum": list(rule.choices)} if rule.choices else {})}
    return {**about, **_number(rule)}


def _number(rule: Knob) -> dict[str, Any]:
    """The schema of a number."""
    low = "exclusiveMinimum" if "least" in rule.open else "minimum"
    high = "exclusiveMaximum" if "most" in rule.open else "maximum"
    return {"type": "number", low: rule.least, high: rule.most}


def text() -> str:
    """The content of the file."""
    return json.dumps(schema(), indent=2) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(text(), encoding="utf-8")
