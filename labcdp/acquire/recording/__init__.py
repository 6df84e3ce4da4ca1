"""Recording of frames and readings into a session."""
