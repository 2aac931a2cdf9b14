"""The report as one HTML page that holds its pictures."""

from __future__ import annotations

import base64
import html
import re

from .findings import Claim, Part, Table, cell
from .runner import Outcome
from .store import Store

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
  max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { line-height: 1.2; } h2 { margin-top: 3rem; border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
figure { margin: 1rem 0; } figure img { max-width: 100%; height: auto; }
figcaption { font-size: .9rem; color: #444; max-width: 50rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .85rem; margin: 1rem 0; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th { border-bottom: 2px solid #444; text-align: right; vertical-align: bottom; }
th, td { padding: .15rem .6rem; }
td { text-align: right; border-bottom: 1px solid #e3e3e3; white-space: nowrap; }
th.text, td.text { text-align: left; white-space: normal; min-width: 4rem; }
.yes, .no { font-weight: 600; white-space: nowrap; }
.yes { color: #0072B2; } .no, .failed { color: #B34700; }
pre { font-size: .8rem; overflow-x: auto; background: #f5f5f5; padding: .6rem; }
details { margin: .6rem 0; } nav td { white-space: normal; }
@media print { details { display: none; } h2 { break-after: avoid; } figure { break-inside: avoid; } }
"""

INTRODUCTION = (
    "Every table and figure of Sepehry, Ehsani, Zhu and Bakhtiari-Nejad (2020), <i>Application of scaled "
    "boundary finite element method for vibration-based"
    " structural health monitoring of breathing cracks</i>, Journal of Vibration and Control, doi <a"
    ' href="https://doi.org/10.1177/1077546320968646">10.1177/1077546320968646</a>, recomputed by '
    "sbfem-petsc. What the paper's text says is held against"
    " numbers; a statement that is not met is reported as such, with what was found instead. "
    "&ldquo;Reference&rdquo; is a converged independent hp finite"
    " element code; the paper's curves are not available as numbers."
)

SOURCES = {"paper": "The paper", "implied": "Implied by the paper", "check": "Check"}


def page(parts: list[Part], outcomes: dict[str, Outcome], store: Store, version: str) -> str:
    """The report.

    Parameters
    ----------
    parts : list of Part
        All, in the order of the report; those without an outcome are named as not computed.
    outcomes : dict of str to Outcome
    store : Store
        Where the pictures are.
    version : str
        Of the libraries.
    """
    body = [
        "<h1>A paper on breathing cracks, "
        f"recomputed</h1>\n<p>{INTRODUCTION}</p>\n<p>{_verdict(outcomes)}</p>\n<p>{html.escape(version)}</p>",
        _contents(parts, outcomes),
    ]
    body += [_section(part, outcomes[part.name], store) for part in parts if part.name in outcomes]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        'content="width=device-width, initial-scale=1"><title>sbfem-petsc:'
        f" the paper, reproduced</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _verdict(outcomes: dict[str, Outcome]) -> str:
    """How many statements are met, in a sentence."""
    claims = [claim for outcome in outcomes.values() if outcome.finding for claim in outcome.finding.claims]
    met = {
        source: f"{sum(c.holds for c in claims if c.source == source)} of "
        f"{sum(c.source == source for c in claims)}"
        for source in SOURCES
    }
    return (
        f"Of the paper's own statements {met['paper']} hold, of those that its text takes for granted "
        f"{met['implied']}; of this report's checks {met['check']}"
        " are met."
    )


def _contents(parts: list[Part], outcomes: dict[str, Outcome]) -> str:
    rows = []
    for part in parts:
        outcome = outcomes.get(part.name)
        if outcome is None:
            state, seconds = "not computed in this run", ""
        elif outcome.finding is None:
            state, seconds = (
                f'<span class="failed">failed: {html.escape(outcome.error)}</span>',
                f"{outcome.seconds:.1f}",
            )
        else:
            claims = outcome.finding.claims
            met = sum(claim.holds for claim in claims)
            state, seconds = (
                (f"{met} of {len(claims)} statements hold" if claims else "no statement to check"),
                f"{outcome.seconds:.1f}",
            )
        title = (
            f'<a href="#{part.name}">{html.escape(part.title)}</a>' if outcome else html.escape(part.title)
        )
        rows.append(f'<tr><td class="text">{title}</td><td class="text">{state}</td><td>{seconds}</td></tr>')
    return (
        '<nav><table><tr><th class="text">part</th><th class="text">verdict</th><th>seconds</th></tr>\n'
        + "\n".join(rows)
        + "</table></nav>"
    )


def _section(part: Part, outcome: Outcome, store: Store) -> str:
    pieces = [f'<h2 id="{part.name}">{html.escape(part.title)}</h2>']
    finding = outcome.finding
    if finding is None:
        return pieces[0] + f'\n<p class="failed">This part failed: {html.escape(outcome.error)}</p>'
    picture = store.picture(part)
    if part.draw is not None and picture.exists():
        data = base64.b64encode(picture.read_bytes()).decode()
        pieces.append(
            f'<figure><img alt="{html.escape(part.caption)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{html.escape(part.caption)}</figcaption></figure>"
        )
    if finding.claims:
        pieces.append(_claims(finding.claims))
    pieces += [_table(table) for table in finding.tables]
    pieces += [f"<p>{_prose(note)}</p>" for note in finding.notes]
    return "\n".join(pieces)


def _claims(claims: list[Claim]) -> str:
    rows = [
        f'<tr><td class="text">{SOURCES[claim.source]}: {_prose(claim.says)}</td><td '
        f'class="text">{_prose(claim.found)}</td>'
        f'<td class="text"><span class="{"yes" if claim.holds else "no"}">'
        f"{'✓ holds' if claim.holds else '✗ does not hold'}</span></td></tr>"
        for claim in claims
    ]
    return (
        '<div class="wide"><table><tr><th class="text">statement</th><th class="text">found</th><th '
        'class="text">verdict</th></tr>\n' + "\n".join(rows) + "</table></div>"
    )


def _table(table: Table) -> str:
    kinds = [' class="text"' if form == "text" else "" for form in table.formats]
    head = "".join(f"<th{kind}>{html.escape(name)}</th>" for kind, name in zip(kinds, table.columns))
    rows = [
        "<tr>"
        + "".join(
            f"<td{kind}>{_typeset(cell(value, form))}</td>"
            for value, form, kind in zip(row, table.formats, kinds)
        )
        + "</tr>"
        for row in table.rows
    ]
    return (
        f'<div class="wide"><table><caption>{html.escape(table.caption)}</caption><tr>{head}</tr>\n'
        + "\n".join(rows)
        + "</table></div>"
    )


def _typeset(text: str) -> str:
    """Text of a cell; true minus signs in numbers."""
    return _prose(text.replace("-", "−") if re.fullmatch(r"[-+]?[\d.,]+(?: %)?", text) else text)


def _prose(text: str) -> str:
    """Text with numbers such as -1.2e-05 as powers of ten."""

    def power(match: re.Match) -> str:
        sign, digits, exponent = match[1].replace("-", "−"), match[2], int(match[3])
        return f"{sign}{digits} × 10<sup>{str(exponent).replace('-', '−')}</sup>" if float(digits) else "0"

    return re.sub(r"(?<![\w.])([-+]?)(\d+(?:\.\d+)?)e([-+]\d+)(?!\w)", power, html.escape(text))
