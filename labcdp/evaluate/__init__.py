"""Evaluations: one package for each kind of question, with its numbers, page and figures."""
