"""Evaluation of recorded sessions."""
