"""Fuzzing of all readers: valid files, ways to damage them, and the readers that must refuse what they cannot read."""
