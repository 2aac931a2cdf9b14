"""One layer between results and files: what a result holds, its class says once."""
