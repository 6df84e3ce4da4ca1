"""Commands at the bench."""
