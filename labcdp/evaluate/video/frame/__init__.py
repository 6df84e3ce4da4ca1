"""CDP of one frame, at the speed of a video."""
