"""Draws the pictures of these pages anew: all, or those that are named.

    ./run python docs/pictures.py discretisation.png lines.png

Each comes from what its page says: the page's own snippets, the README's program, or an example. All of them
take some minutes.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import warnings

DOCS = pathlib.Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

# Pages whose snippets, one after the other, write the picture.
PAGES = {
    "response.png": "../README.md",
    "basins.png": "basins.md",
    "swept.png": "swept.md",
    "lines.png": "quasi_periodic.md",
    "own_tones.png": "quasi_periodic.md",
    "rubbing_sidebands.png": "friction.md",
    "rubbing_map.png": "friction.md",
}
BEAM, REPORT = ("examples/beam_notch.py",), "examples/paper/reproduce.py"
SWEEP = ("-m", "sbfem_petsc", "sweep", "examples/modulation_map.toml")
# Programs, to which the output's folder is added, and what they write there.
PROGRAMS = {
    "discretisation.png": (BEAM, "discretisation.png"),
    "crack.png": (BEAM, "crack.png"),
    "breathing.gif": (("-m", "sbfem_petsc", "run", "examples/breathing.toml"), "pictures/steady_crack1.gif"),
    "backbone.png": (("examples/backbone.py",), "backbone.png"),
    "loci.png": (("examples/loci.py",), "loci.png"),
    "detection.png": (("examples/detection.py",), "detection.png"),
    "modulation_map.png": (SWEEP, "pictures/lines_modulation_index.png"),
    "paper_frequencies.png": ((REPORT, "--only", "table6"), "table6.png"),
    "paper_energy.png": ((REPORT, "--only", "eq25"), "eq25.png"),
    "paper_response.png": ((REPORT, "--only", "fig11"), "fig11.png"),
}


def main() -> None:
    """Draw the pictures that the command line names."""
    wanted = sys.argv[1:] or [*PAGES, *PROGRAMS]
    for name in wanted:
        if name not in PAGES and name not in PROGRAMS:
            sys.exit(f"{name}: no picture of these pages; there are {', '.join([*PAGES, *PROGRAMS])}")
    draw(wanted, DOCS)


def draw(wanted: list[str], into: pathlib.Path) -> None:
    """Draw pictures into a folder; what makes several runs once."""
    with tempfile.TemporaryDirectory(prefix="sbfem-pictures-") as scratch:
        for page in dict.fromkeys(PAGES[name] for name in wanted if name in PAGES):
            _run_page(DOCS / page, pathlib.Path(scratch))
        for name in wanted:
            if name in PAGES:
                shutil.copy(pathlib.Path(scratch) / name, into / name)
        programs = dict.fromkeys(PROGRAMS[name][0] for name in wanted if name in PROGRAMS)
        for number, program in enumerate(programs):
            folder = pathlib.Path(scratch) / f"out{number}"
            _run_program(program, folder)
            for name in wanted:
                if name in PROGRAMS and PROGRAMS[name][0] == program:
                    shutil.copy(folder / PROGRAMS[name][1], into / name)


def _run_page(page: pathlib.Path, folder: pathlib.Path) -> None:
    """Execute the snippets of a page, those behind its last picture left out."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        names: dict = {}
        snippets = re.findall(r"```python\n(.*?)```", page.read_text(), re.S)
        last = max(k for k, snippet in enumerate(snippets) if "save_picture(" in snippet)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for snippet in snippets[: last + 1]:
                exec(compile(snippet, page.name, "exec"), names)
    finally:
        os.chdir(before)


def _run_program(program: tuple[str, ...], folder: pathlib.Path) -> None:
    command = [sys.executable, *program, "--output", str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL)
    if "sweep" in program:
        plot = [sys.executable, "-m", "sbfem_petsc", "plot", str(folder), "--quiet"]
        subprocess.run(plot, cwd=ROOT, env=environment, check=True)


if __name__ == "__main__":
    main()
