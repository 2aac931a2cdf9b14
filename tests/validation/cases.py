"""All cases, in the order of the page."""

from tests.validation import (  # noqa: F401
    contact_cases,
    crack_cases,
    impact_cases,
    mode_cases,
    selement_cases,
)
