"""Commands that evaluate sessions."""
