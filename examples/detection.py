"""Which indicator sees a breathing crack, from what depth on? The sweep of detection.toml, and its picture.

python examples/detection.py
mpiexec -n 2 python examples/detection.py --frequency-noise 1e-4 --floor -100
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run


def main():
    """Run the example."""
    parser = Parser("Probability of detection over depth, by frequency shifts, harmonics and sidebands.")
    parser.add_argument("--case", default=str(pathlib.Path(__file__).with_suffix(".toml")), help="case file")
    parser.add_argument("--frequency-noise", type=float, default=1e-3, help="error of a natural frequency")
    parser.add_argument(
        "--floor", type=float, default=-90.0, help="noise in a line, dB below the strongest line"
    )
    parser.add_argument("--false-alarm", type=float, default=0.01, help="probability without a crack")
    parser.add_output("detection", "sweep and picture", "compute only")
    own = parser.parse()
    import numpy as np

    import sbfem_petsc as sb
    from sbfem_petsc.indicators import detection_probability

    comm, out, folder = begin(own.output)
    study = sb.sweep(own.case, output=folder, comm=comm)
    depth, place = (study.inputs[f"geometry.notches[0].{key}"] for key in ("depth", "x"))
    steady, modulated = (study.values[f"{name}/harmonics/A"] for name in ("steady", "modulated"))
    floor = 10.0 ** (own.floor / 20.0)
    # Lines are read relative to the strongest one, which fills the instrument's range: the drive, and
    # the pump at 2 x 200 Hz. Sidebands stand at (15 -+ 2 n) x 200 Hz.
    ways = {
        "natural frequencies 1-6": (study.values["frequencies/frequency_shift"], own.frequency_noise),
        "harmonics 2-4": (steady[:, 2:5] / np.abs(steady[:, 1:2]), floor),
        "sidebands 1, 2": (modulated[:, [11, 13, 17, 19]] / np.abs(modulated[:, 2:3]), floor),
    }
    seen = {name: detection_probability(*way, own.false_alarm) for name, way in ways.items()}
    depths = np.unique(depth)
    out.print("depth mm  " + "  ".join(seen))
    for value in depths:
        mean = [np.mean(chance[depth == value]) for chance in seen.values()]
        out.print(f"{1e3 * value:8.2f}  " + "  ".join(f"{m:{len(name)}.3f}" for name, m in zip(seen, mean)))
    if not own.no_pictures:
        from sbfem_petsc.plot import plot_detection, save_picture

        axes = plot_detection(depth, place, seen, comm=comm)
        picture = save_picture(axes, f"{folder}/detection.png")
        out.print(f"picture: {picture}")


if __name__ == "__main__":
    run(main)
