"""Published problems: cases, the page VALIDATION.md that they write, and the test that holds both."""
