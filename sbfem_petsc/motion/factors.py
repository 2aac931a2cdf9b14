"""What curves may be over beside the forcing frequency."""

# Factors, by the names of arguments of `Period.at`, and what they are on; that in words.
FACTORS = {"load": "the oscillating loads", "damping": "all damping ratios", "gap": "all gaps"}
WORDS = " or ".join(", ".join(FACTORS.values()).rsplit(", ", 1))
