"""What a gmsh script (.geo) may do: read before gmsh sees it, and handed to gmsh without its comments.

gmsh's scripts can start programs, write files and end the process. What reaches beyond the model is refused
by name and line. gmsh itself is then given the text that was checked, not the file: without comments, with
strings set apart and with short lines, so that nothing in it can be read in two ways (gmsh skips the branches
of an ``If`` without regard to quotes, and goes on after a loop at the start of a line).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NoReturn

_PROGRAM = "starts a program"
_FILE = "writes or reads another file"
_END = "ends the process"
_BUILT = "runs text as commands"
_OTHER = "is not needed to describe a plane model"

# Words of gmsh's language and what they do.
REFUSED = {
    "SystemCall": _PROGRAM,
    "NonBlockingSystemCall": _PROGRAM,
    "System": _PROGRAM,
    "OnelabRun": _PROGRAM,
    "OnelabAction": _PROGRAM,
    "ExternalProcess": _PROGRAM,
    "CommandLine": _PROGRAM,
    "Solver": _PROGRAM,
    "SendToServer": _PROGRAM,
    "Plugin": "runs a plugin, which may write files",
    "Exit": _END,
    "Abort": "leaves the rest of the file out",
    "Save": _FILE,
    "Print": _FILE,
    "CreateDir": _FILE,
    "FileName": _FILE,
    "ListFromFile": _FILE,
    "Homology": _FILE,
    "Cohomology": _FILE,
    "Betti": _FILE,
    "StringToName": _BUILT,
    "S2N": _BUILT,
    "GetEnv": "reads the environment",
    "NewModel": _OTHER,
    "Sleep": _OTHER,
    "Draw": _OTHER,
    "Slide": _OTHER,
    "PartitionMesh": _OTHER,
    "CreateOverlaps": _OTHER,
    "SetCurrentWindow": _OTHER,
    "SplitCurrentWindowHorizontal": _OTHER,
    "SplitCurrentWindowVertical": _OTHER,
    "UnsplitWindow": _OTHER,
}
_NEVER_IN_TEXT = re.compile(r"(?<![A-Za-z_])(NonBlockingSystemCall|SystemCall|OnelabRun)(?![A-Za-z_])")
_READS = ("Include", "Merge", "MergeWithBoundingBox", "ShapeFromFile")
_BEFORE_TEXT = ("SetName", "OptimizeMesh", "View", "Show", "Hide")  # words that a string may follow
_SPEAKS = ("Printf", "Warning", "Error")
_OPTIONS_OF_FILES = re.compile("file|executable|command|pattern|path|server|socket|folder|director", re.I)
_LONGEST_STRING = 1000  # bytes; gmsh cuts at 1023
_LONGEST_LINE = 2000
_AHEAD_OF_STRING = " " * 8  # longer than what gmsh looks ahead when it skips a branch

_TOKEN = re.compile(
    r"""(?P<blank>[ \t\n\f]+)
    |(?P<comment>//[^\n]*|/\*.*?\*/)
    |(?P<open>/\*)
    |(?P<text>"[^"]*"|'[^']*')
    |(?P<word>[A-Za-z_][A-Za-z_0-9]*)
    |(?P<number>(?:[0-9]+\.[0-9]*|[0-9]*\.[0-9]+|[0-9]+)(?:[Ee][-+]?[0-9]+)?)
    |(?P<sign>>>|.)""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    line: int


@dataclass
class Script:
    """A checked script.

    Attributes
    ----------
    text : str
        What gmsh is given.
    reads : list of (str, int, str)
        Other files: the statement, its line, the file's name as it is written.
    """

    text: str
    reads: list[tuple[str, int, str]] = field(default_factory=list)


def scan_script(content: bytes, origin: str) -> Script:
    """Check a gmsh script.

    Parameters
    ----------
    content : bytes
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A statement that starts programs, writes files or ends the process; a name of a file that is not
        written out; bytes that are no text.
    """
    text = _decoded(content, origin)
    tokens, clean = _tokens(text, origin)
    script = Script(clean)
    for i, token in enumerate(tokens):
        if token.kind == "word":
            _check_word(tokens, i, origin, script)
        elif token.kind == "text":
            _check_text(tokens, i, origin)
    return script


def _decoded(content: bytes, origin: str) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(
            f"{origin}: line {line} holds the byte 0x{content[error.start]:02x}, which is no text (UTF-8); "
            "the file is damaged or no gmsh script."
        ) from None
    text = text.replace("\r\n", "\n")
    strange = re.search(r"[^\t\n\f\x20-\x7e\x80-\U0010ffff]|[\x80-\x9f\u2028\u2029]", text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        raise ValueError(
            f"{origin}: line {line} holds the control character {strange.group()!r}; the file is damaged or "
            "no gmsh script."
        )
    return text


def _tokens(text: str, origin: str) -> tuple[list[_Token], str]:
    """Words, numbers, strings and signs, and the text without comments."""
    tokens: list[_Token] = []
    clean: list[str] = []
    line, column = 1, 0
    for match in _TOKEN.finditer(text):
        kind, piece = str(match.lastgroup), match.group()
        if kind == "open" or (kind == "sign" and piece in "\"'"):
            what = "comment" if kind == "open" else "string"
            raise ValueError(f"{origin}: the {what} that begins in line {line} does not end; close it.")
        if kind == "comment":
            piece_out = " " + "\n" * piece.count("\n")
        elif kind == "text":
            if len(piece.encode()) > _LONGEST_STRING:
                raise ValueError(
                    f"{origin}: the string that begins in line {line} is longer than {_LONGEST_STRING} "
                    "bytes; close it."
                )
            # No line begins within a string: gmsh goes on after a loop at the start of a line.
            piece_out = _AHEAD_OF_STRING + piece.replace("\n", " ") + "\n" * piece.count("\n")
        else:
            piece_out = piece
        if kind not in ("comment", "blank"):
            tokens.append(_Token(kind, piece, line))
        clean.append(piece_out)
        line += piece.count("\n")
        column = len(piece_out) - piece_out.rfind("\n") if "\n" in piece_out else column + len(piece_out)
        if column > _LONGEST_LINE and kind == "sign" and piece in ",;":
            clean.append("\n")
            column = 0
    return tokens, "".join(clean) + "\n"  # without, gmsh drops all but the first statement of a last line


def _refuse(origin: str, token: _Token, what: str, mend: str = "remove it") -> NoReturn:
    raise ValueError(f"{origin}: {token.text} in line {token.line} {what}, which is not done here; {mend}.")


def _check_word(tokens: list[_Token], i: int, origin: str, script: Script) -> None:
    token, word = tokens[i], tokens[i].text
    before, after = _text(tokens, i - 1), _text(tokens, i + 1)
    if word in REFUSED and not (word == "Print" and after == "."):
        mend = "read_gmsh meshes the model by itself, remove the statement" if word == "Save" else "remove it"
        if word == "Plugin":
            mend = "cracks are opened here, name their curves crack:NAME and remove the plugin"
        _refuse(origin, token, REFUSED[word], mend)
    if re.search(r"[0-9](EndIf|EndFor|Else|ElseIf|Return)(?![A-Za-z_])", word):
        # gmsh finds the end of a branch it skips in the middle of such a name.
        _refuse(origin, token, "is a name in which gmsh may find a command", "call it something else")
    if word in ("General", "PostProcessing", "Print") and after == ".":
        option = _text(tokens, i + 2)
        if _OPTIONS_OF_FILES.search(option):
            _refuse(origin, token, f"sets the option {option}, which names files or programs")
    if word in ("Macro", "Function") and after == "(":
        _refuse(origin, token, _BUILT, f"write {word} NAME ... Return")
    if word in _SPEAKS and after == "(":
        end = _closing(tokens, i + 1)
        if _text(tokens, end + 1) in (">", ">>"):
            _refuse(origin, token, _FILE, "print without '>'")
    if word in _READS and before not in (".", ","):
        at = i + 2 if after == "(" else i + 1
        closing = ")" if after == "(" else ";"
        if at >= len(tokens) or tokens[at].kind != "text" or _text(tokens, at + 1) != closing:
            _refuse(origin, token, "reads a file whose name is not written out", f'write {word} "name";')
        script.reads.append((word, token.line, tokens[at].text[1:-1]))


def _check_text(tokens: list[_Token], i: int, origin: str) -> None:
    token = tokens[i]
    hidden = _NEVER_IN_TEXT.search(token.text)
    if hidden:
        _refuse(
            origin, token, f"holds the word {hidden.group()}, which starts a program", "call it otherwise"
        )
    before = tokens[i - 1] if i else _Token("sign", ";", 0)
    plain = before.kind == "sign" and before.text not in ("}", "]", ")")
    # In a list ("Name" of a parameter, say) a word stands before a string after a comma.
    listed = before.kind == "word" and _text(tokens, i - 2) in (",", "{")
    known = before.kind == "word" and (before.text in _READS or before.text in _BEFORE_TEXT)
    if not (plain or listed or known):
        _refuse(origin, before, f"before the string {token.text} is no statement that is known here")


def _text(tokens: list[_Token], i: int) -> str:
    return tokens[i].text if 0 <= i < len(tokens) and tokens[i].kind != "text" else ""


def _closing(tokens: list[_Token], opening: int) -> int:
    """Index of the bracket that closes the one at `opening`; the number of tokens if none does."""
    depth = 0
    for i in range(opening, len(tokens)):
        if tokens[i].kind == "sign":
            depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(tokens[i].text, 0)
            if depth <= 0:
                return i
    return len(tokens)
