"""The page on which regions are drawn by mouse."""
