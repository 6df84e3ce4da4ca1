"""Properties of computer and network relevant for a camera stream, with remedies."""
