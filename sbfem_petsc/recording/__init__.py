"""Files that are kept up to date while an analysis runs."""
