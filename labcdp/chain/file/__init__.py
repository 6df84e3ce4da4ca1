"""Chain files: tables of the parts of a chain, and the classes they stand for."""
