"""Videos, image sequences and recorded sessions as sequences of frames."""
