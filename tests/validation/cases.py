"""All cases, in the order of the page."""

from tests.validation import (  # noqa: F401
    impact_cases,
    mode_cases,
    contact_cases,
    crack_cases,
    selement_cases,
)
