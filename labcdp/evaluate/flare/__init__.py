"""Flare: stray light of a camera beside a source, in one or several pictures."""
