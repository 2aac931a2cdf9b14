"""Options of programs whose other options are PETSc's, and their output through a pipe."""

import subprocess
import sys
from pathlib import Path

import pytest

from sbfem_petsc.command_line import Parser


@pytest.fixture
def parser():
    parser = Parser("A program.")
    parser.add_numbers(
        forces=([1.0, 300.0], "amplitudes, N"), time_step=(1e-6, "s"), modes=(int, "modes kept (default: 80)")
    )
    parser.add_tip_mesh()
    return parser


def test_defaults(parser):
    own, rest = parser.parse_known_args([])
    assert vars(own) == {
        "forces": [1.0, 300.0],
        "time_step": 1e-6,
        "modes": None,
        "order": 6,
        "grading": 1.8,
        "tip_size": 5e-6,
    }
    assert rest == []


def test_numbers_of_the_defaults_kind(parser):
    own, rest = parser.parse_known_args("--forces 5 6 --modes 40 --order 3 -static_ksp_type cg".split())
    assert own.forces == [5.0, 6.0] and own.modes == 40 and own.order == 3
    assert rest == ["-static_ksp_type", "cg"]


@pytest.mark.parametrize("words", ["--order 2.5", "--forces", "--time-step fast"])
def test_what_is_no_number_ends_the_program(parser, words, capsys):
    with pytest.raises(SystemExit) as ended:
        parser.parse_known_args(words.split())
    assert ended.value.code == 2 and words.split()[0] in capsys.readouterr().err


def test_help_tells_every_default_once(parser):
    text = " ".join(parser.format_help().split())
    for told in ("(default 1 300)", "s (default 1e-6)", "(default: 80)", "(default 6)", "(default 5e-6)"):
        assert text.count(told) == 1


PRINTS = """
from sbfem_petsc.command_line import run
import sbfem_petsc.petsc

def main():
    for number in range(100000):
        print(number)

run(main)
"""


@pytest.mark.slow
def test_output_that_is_not_read_to_its_end():
    """As by `| head`: the program ends without a word, in particular without PETSc's dump of a signal."""
    root = Path(__file__).resolve().parents[2]
    with subprocess.Popen(
        [sys.executable, "-c", PRINTS], cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as program:
        assert program.stdout.readline() == b"0\n"
        program.stdout.close()
        assert program.stderr.read() == b""
        assert program.wait(60) == 0
