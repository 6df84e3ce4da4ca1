"""Results as JSON."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any


def results_json(values: Any) -> str:
    """Write values as JSON; infinity and nan, which it does not have, become null."""
    return json.dumps(_finite(values), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(values: Any) -> Any:
    if isinstance(values, dict):
        return {key: _finite(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [_finite(value) for value in values]
    return None if isinstance(values, float) and not isfinite(values) else values
