"""Files that a stranger has made up, checksums and all: each is read as what it says, or refused in one
sentence.
"""

from __future__ import annotations

import re
import shutil
import warnings

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.record.record import entries, record_class
from sbfem_petsc.system.body import Body
from tests.fuzz import examples

# Results of nonlinear vibration.
RESULTS = {
    "backbone": examples.backbone,
    "loci": lambda: [examples.locus()],
    "basins": examples.two_axes,
    "swept": examples.swept_response,
    "torus": examples.quasi_periodic,
    "tori": examples.quasi_periodic_branch,
}


KINDS = ["history", "unreduced", "orbit", "branch", "results", *RESULTS]
ORDINARY = ("history", "branch", "results", "torus")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A small file of each kind."""
    folder = tmp_path_factory.mktemp("files")
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.001)]).mesh(order=1, face_edges=2)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.02)
    push, burst = sb.PointForce("A", fy=10.0), sb.PointForce("A", fy=sb.Harmonic(10.0, 700.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, reduction in (("history", "modes"), ("unreduced", None)):
            history = sb.transient(model, burst, 2e-4, 1e-5, modes=4, reduction=reduction)
            sb.save(folder / f"{name}.h5", history)
        sb.transient(model, burst, 2e-4, 1e-5, modes=4, file=folder / "journal")
        orbit = sb.periodic(model, push, 700.0, modes=4, steps=64)
        sb.save(folder / "orbit.h5", orbit)
        branch = sb.frequency_response(model, push, 700.0, 702.0, modes=4, steps=64, points=4)
        sb.save(folder / "branch.h5", branch)
        for name, make in RESULTS.items():
            sb.save(folder / f"{name}.h5", make())
        sb.save(folder / "results.h5", {"modes": sb.modal(model, 2), "push": sb.static(model, push)})
    return {name: folder / f"{name}.h5" for name in KINDS}


def changed(path, copy, change):
    """A copy with a change; HDF5 writes its checksums itself."""
    shutil.copy(path, copy)
    with h5py.File(copy, "r+") as file:
        change(file)
    return copy


# Attributes of every data set, which readers treat alike wherever they stand.
EVERYWHERE = ("long_name", "units", "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST")


def items(path):
    """Names of all data sets, and (object, attribute) of all attributes; of those of every data set four."""
    sets, attributes = [], []

    def look(name, item):
        if isinstance(item, h5py.Dataset):
            sets.append(name)
        attributes.extend((name, key) for key in item.attrs)

    with h5py.File(path) as file:
        look("/", file)
        file.visititems(look)
    assert len(sets) >= 4 and attributes
    few = [entry for entry in attributes if entry[1] not in EVERYWHERE]
    for common in EVERYWHERE:
        places = [entry for entry in attributes if entry[1] == common]
        few += places[:: len(places) // 4 or 1][:4]
    return sets, few


def put(name, make):
    """Replace a data set by another with the same attributes."""

    def change(file):
        former, attributes = file[name][()], dict(file[name].attrs)
        del file[name]
        file[name] = make(former)
        file[name].attrs.update(attributes)

    return change


def nan_inside(name):
    """The first number is no number."""

    def change(file):
        values = np.array(file[name][()])
        values.reshape(-1)[:1] = np.nan
        file[name][...] = values

    return change


def refused(copy):
    """The sentence that a file ends in; None if it is read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            repr(sb.read(copy))
    except ValueError as error:
        assert "\n" not in str(error) and str(copy) in str(error) and len(str(error)) < 600, error
        return str(error)
    return None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "part"),
    [
        pytest.param(kind, part, marks=[pytest.mark.long] * (part > 0 or kind not in ORDINARY))
        for kind in KINDS
        for part in range(12)
    ],
)
def test_every_part_in_turn(kind, part, files, tmp_path):
    """Left out, of another type or shape, or not a number; whatever becomes of it, no error from below. In
    the ordinary suite every twelfth of some kinds.
    """
    path = files[kind]
    copy, (sets, attributes) = tmp_path / path.name, items(path)
    # the reduced model, of which each motion has one, stands in a torus, and the body of each in results
    parts = "reduced(_model)?|body" if kind != "torus" else "body"
    if kind != "results":
        sets = [name for name in sets if not re.search(rf"\b({parts})/", name)]
        attributes = [entry for entry in attributes if not re.search(rf"\b({parts})(/|$)", entry[0])]
    accepted = []
    for name in sets[part::12]:
        with h5py.File(path) as file:
            numeric, size = file[name].dtype.kind in "fc", file[name].size
        ways = {
            "left out": lambda file, name=name: file.__delitem__(name),
            "text": put(name, lambda value: "a"),
            "shape": put(name, lambda value: np.zeros((3, 1, 7, 1), dtype=getattr(value, "dtype", float))),
        }
        if numeric and size:
            ways["nan"] = nan_inside(name)
        for way, change in ways.items():
            if refused(changed(path, copy, change)) is None:
                accepted.append((name, way))
    for name, key in attributes[part::12]:
        for value in (-1, "a", np.nan, 10**12):
            made = changed(path, copy, lambda file, n=name, k=key, v=value: file[n].attrs.__setitem__(k, v))
            if refused(made) is None and value != 10**12:
                accepted.append((f"{name}@{key}", value))
    assert [entry for entry in accepted if is_read(path, *entry)] == []


def is_read(path, place, way):
    """Whether what was changed is read, may not be missing, and may not be so."""
    place, _, key = place.partition("@")
    group, name = (place, key) if key else place.rpartition("/")[::2]
    with h5py.File(path) as file:
        cls = record_class(file[group or "/"].attrs.get("record", b"Body").decode())
    found = [entry for entry in entries(cls).values() if entry.called == name]
    if cls is Body or not any(entry.field or entry.back for entry in found):
        return False
    (entry,) = found
    may_be_missing = way == "left out" and (not entry.needed or "None" in entry.type)
    return not (may_be_missing or (str(way) == "nan" and not entry.finite) or entry.kinds == "U")


def link(file):
    file["more"] = h5py.ExternalLink("/etc/hostname", "/")


def soft(file):
    file["more"] = h5py.SoftLink("/")


def elsewhere(file):
    file.create_dataset("more", (8,), dtype="u1", external=[("/etc/hostname", 0, 8)])


def virtual(file):
    layout = h5py.VirtualLayout((8,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", (8,))
    file.create_virtual_dataset("more", layout)


def endless(file):
    file["round"] = file["/"]


def bomb(file):
    file.create_dataset("more", (1 << 40,), "f4", chunks=(1 << 20,), compression="gzip")


def huge(file):
    file.create_dataset("more", (1 << 40,), "f4", chunks=(1 << 20,))


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_not_the_files_own(kind, files, tmp_path):
    """Links, storage in other files, rings, and data that would fill the memory."""
    path = files[kind]
    for change in (link, soft, elsewhere, virtual, endless, bomb, huge):
        told = refused(changed(path, tmp_path / "file.h5", change))
        assert told is not None and "elsewhere" in told or "twice" in told or "larger than" in told


def test_a_history_larger_than_the_memory(files, monkeypatch):
    """Told with the way to read it all the same."""
    from sbfem_petsc.motion.files import history_file

    path = files["history"].with_name("journal")
    monkeypatch.setattr(history_file, "available_memory", lambda: 1000)
    with pytest.raises(ValueError, match="of memory, 900 bytes are free; read it with in_memory = False"):
        sb.read(path)
    assert len(sb.read(path, in_memory=False).time) == 21


def test_a_copy_is_read(files, tmp_path):
    for path in files.values():
        shutil.copy(path, tmp_path / path.name)
        assert refused(tmp_path / path.name) is None
        assert refused(changed(path, tmp_path / path.name, lambda file: None)) is None
