"""Finished parts on disk: one JSON, one NPZ and one PNG each, written whole or not at all and reused while
their inputs are the same.
"""

from __future__ import annotations

import hashlib
import json
import pathlib
import zipfile

import numpy as np

from sbfem_petsc.writing import replaced

from .bench import REFERENCE
from .findings import Claim, Finding, Part, Table, plain

ROOT = pathlib.Path(__file__).resolve().parents[2]


def fingerprint(version: str, options: dict[str, str]) -> str:
    """Digest of all that the numbers depend on: sources, reference data, versions of the libraries,
    options of the solves.
    """
    digest = hashlib.sha256(json.dumps([version, np.__version__, sorted(options.items())]).encode())
    sources = [
        path
        for folder in ("meshing", "sbfem_petsc", "examples/paper")
        for path in (ROOT / folder).rglob("*.py")
    ]
    for path in sorted([*sources, *REFERENCE.iterdir()]):
        if path.is_file():
            digest.update(str(path.relative_to(ROOT)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


class Store:
    """Folder of the report.

    Parameters
    ----------
    folder : str
    inputs : str
        Fingerprint; what was stored under another one is not reused.
    """

    def __init__(self, folder: str, inputs: str):
        self.folder, self.inputs = pathlib.Path(folder), inputs
        self.parts = self.folder / "parts"

    def prepare(self) -> None:
        """Make the folder of the parts."""
        self.parts.mkdir(parents=True, exist_ok=True)

    def picture(self, part: Part) -> pathlib.Path:
        """The part's PNG."""
        return self.folder / f"{part.name}.png"

    def save(self, part: Part, finding: Finding, seconds: float, pictures: bool) -> None:
        """Write curves and picture, then the JSON, which alone makes the part count as finished."""
        self._replace(f"{part.name}.npz", lambda file: np.savez_compressed(file, **finding.curves))
        if pictures and part.draw is not None:
            part.draw(finding, str(self.picture(part)))
        content = {
            "inputs": self.inputs,
            "seconds": seconds,
            **{name: plain(getattr(finding, name)) for name in ("numbers", "tables", "claims", "notes")},
        }
        self._replace(f"{part.name}.json", lambda file: file.write(json.dumps(content, indent=1).encode()))

    def load(self, part: Part, pictures: bool) -> tuple[Finding, float] | None:
        """A finished part with the same inputs and its seconds, or None."""
        try:
            content = json.loads((self.parts / f"{part.name}.json").read_text())
            if content["inputs"] != self.inputs or (
                pictures and part.draw is not None and not self.picture(part).exists()
            ):
                return None
            with np.load(self.parts / f"{part.name}.npz") as archive:
                curves = dict(archive)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None
        tables, claims = (
            [kind(**item) for item in content[name]] for name, kind in (("tables", Table), ("claims", Claim))
        )
        return Finding(content["numbers"], tables, claims, content["notes"], curves), content["seconds"]

    def forget(self, part: Part) -> None:
        """A part that is computed again has no old result or picture if that fails."""
        for path in (self.parts / f"{part.name}.json", self.picture(part)):
            path.unlink(missing_ok=True)

    def _replace(self, name: str, write) -> None:
        with replaced(self.parts / name, "part") as temporary, open(temporary, "wb") as file:
            write(file)


def write_text(path: pathlib.Path, text: str) -> None:
    """Write a file whole or not at all."""
    with replaced(path, "page") as temporary:
        pathlib.Path(temporary).write_text(text, encoding="utf-8")
