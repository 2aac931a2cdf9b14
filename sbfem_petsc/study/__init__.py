"""A user's own case: case file, runs, sweeps, reports."""
