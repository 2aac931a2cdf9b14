"""Tone bursts on the paper's beam with a breathing crack: Figs. 5 and 6.

Case P, undamped, under bursts of 100 cycles at 3000 Hz and of 1 N and 300 N (eq. 39, which peaks at twice
that) at A, 0-33 ms. At 1 N the crack stays open; at 300 N it breathes. Histories on a mesh refined towards
the tip and on the default mesh are compared with an independent hp finite element computation (error 2e-4).

    python examples/tone_burst.py --convergence      also tables over modes, steps and meshes (a minute)
"""

import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Tone bursts of 1 N and 300 N on the paper's beam with a breathing crack (Figs. 5 and 6).")
parser.add_numbers(duration=(0.033, "s (default 0.033; shorter: compared over that time)"))
parser.add_numbers(step=(1e-6, "time step, s"), modes=(80, "modes kept"))
parser.add_tip_mesh()
more = "tables of errors over modes, steps and meshes, with observed rates"
parser.add_argument("--convergence", action="store_true", help=more)
parser.add_output("tone_burst", "histories and pictures", "write the histories only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables import tone_burst as tables

    comm, out, folder = begin(own.output)
    reference, frequencies = tables.read_reference()
    rows, histories = [], {}
    refined = {"order": own.order, "grading": own.grading, "tip_size": own.tip_size}
    for mesh, choice in {"refined": refined, "default": {}}.items():
        model = tables.build(comm, **choice)
        out.print(f"{mesh} mesh: {model}")
        error = abs(sb.modal(model, own.modes).frequencies[:10] / frequencies - 1.0).max()
        for force in (1.0, 300.0):
            began = time.perf_counter()
            history = sb.transient(model, tables.burst(force), own.duration, step=own.step, modes=own.modes)
            histories[mesh, force] = history
            rows.append((mesh, len(model.pairs), error, force, history, time.perf_counter() - began))
        model.destroy()
    tables.print_tables(out, rows, histories, reference, own.duration)
    for table in tables.convergence(comm, own.duration, reference) if own.convergence else ():
        out.print(table)
    sb.on_root(comm, lambda: tables.write_histories(folder, histories))
    if not own.no_pictures:
        tables.pictures(folder, comm, histories, reference, own.duration)
    out.print(f"\nhistories and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
