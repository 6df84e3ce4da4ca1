"""The computer that labcdp runs on: compiled loops and processes."""
