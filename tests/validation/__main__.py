"""Write VALIDATION.md: all cases, or those named, the others as they stand."""

from __future__ import annotations

import sys
import time

from tests.validation import cases  # noqa: F401  (registers them)
from tests.validation.page import CASES, PAGE, page

wanted = sys.argv[1:] or list(CASES)
text = PAGE.read_text() if PAGE.exists() else ""
sections = []
for key, case in CASES.items():
    if key in wanted:
        start = time.process_time()
        rows = list(case.compute())
        sections.append(case.text(rows))
        late = [row.quantity for row in rows if row.held is not None and row.difference > row.held]
        print(f"{key}: {time.process_time() - start:.1f} s{', NOT HELD: ' + ', '.join(late) if late else ''}")
        for row in rows:
            print("   ", " | ".join(row.cells()))
    else:
        at = text.find(f"## {case.title}\n")
        if at >= 0:
            sections.append("## " + text[at + 3 :].split("\n## ")[0].rstrip() + "\n")
PAGE.write_text(page(sections))
