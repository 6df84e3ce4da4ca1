"""Diagnosis: what keeps a bench from working, and what mends it."""

from .finding import Finding
from .stream import StreamFacts, stream_causes

__all__ = ["Finding", "StreamFacts", "stream_causes"]
