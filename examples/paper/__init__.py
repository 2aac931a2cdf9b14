"""Parts of `reproduce_paper.py`: the tables and figures of Sepehry et al. (2020), recomputed and checked."""
