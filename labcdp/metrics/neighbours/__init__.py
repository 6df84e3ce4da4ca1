"""CDP between each pixel and its neighbours."""
