"""Pictures and video frames to luminance."""
