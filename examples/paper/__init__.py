"""The tables and figures of Sepehry et al. (2020), recomputed and checked by `reproduce.py`."""
