"""All cases; importing them registers them, in the order of the page."""

from tests.validation import (  # noqa: F401, I001
    impact_cases,
    contact_cases,
    crack_cases,
    interface_cases,
    mode_cases,
    selement_cases,
)
