"""Pictures: what a file says, and the frame that it gives."""
