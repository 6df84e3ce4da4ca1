"""Commands for pictures and videos."""
