"""Format numbers of bytes."""

from __future__ import annotations


def size(n_bytes: float) -> str:
    """Return a number of bytes with its unit, for example ``10.1 MB`` (10^6 bytes)."""
    if n_bytes < 1e5:
        return f"{n_bytes:.0f} bytes"
    return f"{n_bytes / 1e3:.0f} kB" if n_bytes < 1e6 else f"{n_bytes / 1e6:.1f} MB"
