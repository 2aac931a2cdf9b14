"""The case file: its tables, where they stand in it, what is wrong with them, the objects they describe."""
