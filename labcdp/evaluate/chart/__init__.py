"""Charts in pictures: all patches against all, and the dynamic range of the camera."""
