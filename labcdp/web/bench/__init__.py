"""The live bench: what camera and meter see now, and the CDP of it."""
