"""Kinds of analysis, one file each. A file that is added here is found; nothing else lists them."""
