"""The page for drawing regions with the mouse."""
