"""A user's gmsh model (.msh, .geo, .step ...) to a boundary mesh."""

from __future__ import annotations

import contextlib
import functools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from meshing.boundary_mesh import BoundaryMesh, Recipe
from meshing.cells.crack_splitting import CrackMeshing, add_cracks
from meshing.cells.s_elements import build_mesh
from meshing.gmsh.building import cells_of
from meshing.gmsh.confined import Rights, ask, landlock_version
from meshing.gmsh.files import FOREIGN, SCRIPTS, checked_content
from meshing.gmsh.length_units import Units
from meshing.gmsh.model import FileModel
from meshing.gmsh.report import (
    check_joined,
    check_units,
    pass_on,
    refuse_empty_groups,
    warn_of_points_on_cracks,
)
from meshing.input_checks import checked_order, flag, length, positive
from meshing.input_checks import path as checked_path

_SHARE_OF_MEMORY = 0.75


def read_gmsh(
    path: str | os.PathLike[str],
    order: int = 5,
    *,
    size: float | None = None,
    scale: float | None = None,
    tip_element: bool = True,
    tip_size: float | None = None,
    grading: float = 2.5,
    face_size: float | None = None,
    face_edges: int = 12,
    max_unknowns: int = 1_000_000,
    time_limit: float = 120.0,
    memory_limit: float | None = None,
    trust: bool = False,
) -> BoundaryMesh:
    """Read a gmsh model; each triangle or quadrilateral becomes an S-element.

    Physical groups say what is what. Physical surfaces are materials (surfaces of ``selement:NAME`` are one
    S-element each, of the material NAME), physical curves edge sets, physical
    points named points (groups without a name are called "surface1", "curve1", "point1" ... by their tags). A
    crack is

    - one physical curve ``crack:NAME``: a line along cell edges, one end inside the material (the tip), the
      other on the outline (the mouth); its two faces are made here, and stand apart by an angle, degrees, at
      the mouth where it is called ``crack:NAME:opening=ANGLE``; or
    - two physical curves ``crack:NAME:right`` and ``crack:NAME:left``: two existing faces that share the
      tip's node and match, e.g. the flanks of a notch, or a line along which gmsh's Crack plugin has
      duplicated the nodes; or two faces of two bodies, that share no node and need not match, e.g. the arc of
      a roller and the edge of a block: they are divided so that their nodes lie beside each other.

    The right face is at the right hand of somebody who looks from the tip to the mouth, of two bodies the one
    with that name. The faces become the edge sets ``NAME_right`` and ``NAME_left``, the mouth's corners the
    points ``NAME_right`` and ``NAME_left`` where there is one mouth; a physical point on an embedded crack
    line belongs to the left face. The cells around each tip, sharp kink and junction are divided anew into
    rings.

    The file is read in a process of its own, which the system lets read the file's folder and compute, and
    nothing else (see `meshing.gmsh.confined`): a script that starts programs, writes files or reads files
    outside its folder is refused, and so is content that is not what the file's ending says.

    Parameters
    ----------
    path : path
        ``.msh`` of version 2 or 4, ASCII or binary, straight or curved elements. ``.geo``, ``.step``,
        ``.brep``, ``.iges`` are meshed here, GLL nodes on the true curves; step, brep and iges carry no
        groups: all surfaces are one material, parts that touch are joined, every curve and point has its
        number in its name ("curve5", "point2"); to name them, write a .geo file that merges the file and adds
        physical groups. ``.inp`` (Abaqus), ``.unv``, ``.med``, ``.vtu``
        and ``.vtk``: see the modules of `meshing.gmsh.foreign`. ``.bdf`` (Nastran): groups have the numbers
        of properties.
    order : int
        Polynomial order of the S-elements' edges, 1 to 20. 1 is too stiff in bending.
    size : float, optional
        Largest cell size when a geometry is meshed, m.
    scale : float, optional
        Length of the file's unit, m: 1e-3 for a model drawn in mm. Without it the unit is that of step and
        iges files, else m. A unit that contradicts the file's, and a model above 20 m or below 1 mm, is
        warned of.
    tip_element : bool
        A small open S-element with its scaling centre on each crack tip, and rings around it.
    tip_size : float, optional
        Half-size of that S-element, m. Default: 0.02 of the crack's length, or 0.03 of the reach of the cells
        around the tip if that is less.
    grading : float
        Largest size ratio of neighbouring rings, 1.1 to 10.
    face_size : float, optional
        Longest edge on the faces of cracks, m. Default: the crack's length divided by `face_edges`.
    face_edges : int
        See `face_size`.
    max_unknowns : int
        Meshes that would have more displacement unknowns are refused, before they are made where that can be
        foreseen.
    time_limit : float
        Longest time for opening and meshing, s.
    memory_limit : float, optional
        Most memory for opening and meshing, bytes; three quarters of the machine's by default.
    trust : bool
        A script may start programs and read and write files as you may. Where the system cannot keep it from
        that (Linux before 5.13, or without Landlock; other systems), scripts are refused without `trust`.

    Returns
    -------
    BoundaryMesh

    Warns
    -----
    UnitWarning
        A model that seems to be drawn in another unit.
    GmshWarning
        What gmsh warns of; a curve inside a material that is no crack; a point on a crack, which is one of
        its left face; a curve inside the element around a crack tip; outlines that lie on one another and
        are not joined.

    Raises
    ------
    TypeError, ValueError
        One sentence that names the file and the item: missing, truncated or not understood, a script that
        does what it may not, no physical groups, groups that hold nothing, a volume, no cells, too many
        cells, not plane, inverted, degenerate or not star-convex cells, surfaces that overlap, crack lines
        that do not lie on cell edges, faces that do not match, groups named like the faces of a crack.
    RuntimeError
        gmsh cannot be loaded, or no process can be started.
    """
    given = {name: value for name, value in locals().items() if name != "path"}
    path = Path(checked_path("read_gmsh", "path", path))
    order = checked_order(order)
    if scale is not None:
        scale = length("read_gmsh", "scale", scale)
    if size is not None:
        length("read_gmsh", "size", size)
    flag("read_gmsh", "tip_element", tip_element)
    trust = flag("read_gmsh", "trust", trust)
    CrackMeshing.checked(0.0, given)
    most = int(positive("read_gmsh", "max_unknowns", max_unknowns))
    seconds = positive("read_gmsh", "time_limit", time_limit, "s")
    memory = _memory() if memory_limit is None else memory_limit
    memory = int(positive("read_gmsh", "memory_limit", memory, "bytes"))
    origin = str(path)
    suffix, content = path.suffix.lower(), checked_content(path)
    units = Units.of(suffix, content, scale, origin)
    options = {"order": order, "size": None if size is None else size / units.factor, "most_unknowns": most}
    trusted = trust and suffix in SCRIPTS
    if suffix in SCRIPTS and not trusted and not landlock_version():
        raise ValueError(
            f"{path}: a gmsh script may start programs and write files, and this system cannot keep it from "
            "that (Linux 5.13 and newer with Landlock can); pass trust=True to read_gmsh if you know what it "
            "does, or save its mesh as .msh."
        )
    with _place(path, suffix, content) as place:
        module = FOREIGN.get(suffix, "meshing.gmsh.extraction")
        answer = ask(origin, place, module, Rights(seconds, memory, trusted), options)
    model = FileModel.unpacked(*answer, units.factor)
    refuse_empty_groups(model, origin)
    pass_on(model, origin)
    cells = cells_of(model, origin)
    where = np.array(cells.vertices)
    check_units(units, model.merged_step, origin, where)
    check_joined(cells, origin)
    if tip_size is not None:
        cells.tip_sizes = {}
    add_cracks(cells, CrackMeshing.checked(float(np.ptp(where, axis=0).max()), given), origin)
    warn_of_points_on_cracks(cells, origin)
    recipe = Recipe(functools.partial(read_gmsh, path.resolve()), given)
    return build_mesh(cells, order, origin, recipe=recipe)


@contextlib.contextmanager
def _place(path: Path, suffix: str, content: bytes) -> Iterator[Path]:
    """Where gmsh opens a file: a script where it is, for it may read what lies beside it; a copy of what was
    checked of others, so that nothing beside them (gmsh runs plate.msh.opt) and no later change has a say.
    """
    if suffix in SCRIPTS:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="sbfem-gmsh-") as folder:
        place = Path(folder) / f"model{suffix}"
        try:
            place.write_bytes(content)
        except OSError as error:
            raise RuntimeError(
                f"{path}: no copy of it can be put into {folder} ({error.strerror}); set TMPDIR to a folder "
                "with room."
            ) from error
        yield place


def _memory() -> float:
    """Three quarters of the machine's, bytes."""
    try:
        return _SHARE_OF_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError):
        return 8 * 2**30
