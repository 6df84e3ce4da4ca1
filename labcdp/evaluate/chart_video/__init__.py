"""Charts in videos."""
