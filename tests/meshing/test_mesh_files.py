"""Boundary meshes in files: what is read is what was written, or an error; nothing is left behind."""

import dataclasses
import hashlib
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from meshing import Beam, BoundaryMesh, VNotch

MESH = Beam(0.1, 0.01, [VNotch(x=0.03, depth=0.005, opening=0.05)]).mesh(order=2, points={"P": (0.05, 0.01)})


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "mesh.h5"
    MESH.save(path)
    return path


def same(one, other):
    """Whether all fields of two meshes are equal, but for how they were made, which a file does not tell."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if dataclasses.is_dataclass(one) and not isinstance(one, type):
        fields = [f.name for f in dataclasses.fields(one) if f.compare]
        return all(same(getattr(one, name), getattr(other, name)) for name in fields)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


def test_all_comes_back_and_the_bytes_are_the_same_every_time(saved, tmp_path):
    assert same(MESH, BoundaryMesh.load(saved))
    MESH.save(tmp_path / "again.h5")
    assert (tmp_path / "again.h5").read_bytes() == saved.read_bytes()
    with h5py.File(saved) as file:  # HDF5's tools read it, too
        assert file["nodes"].shape == MESH.nodes.shape and "m" in file["nodes"].attrs["description"]


def test_a_flipped_byte_anywhere_is_an_error(saved):
    """300 places over the whole file, the block ahead of it among them."""
    content = saved.read_bytes()
    random = np.random.default_rng(7)
    places = np.concatenate([random.integers(0, len(content), 280), np.arange(0, 200, 10)])
    for place in places:
        broken = bytearray(content)
        broken[place] ^= int(random.integers(1, 256))
        saved.write_bytes(broken)
        with pytest.raises(ValueError, match=r"mesh\.h5: it (is not|has version)|checksum differs"):
            BoundaryMesh.load(saved)


@pytest.mark.parametrize("keep", [0, 1, 100, 511, 512, 513, 0.5, -1])
def test_truncated_files(saved, keep):
    content = saved.read_bytes()
    saved.write_bytes(content[: int(keep * len(content)) if isinstance(keep, float) else keep])
    with pytest.raises(ValueError, match="damaged"):
        BoundaryMesh.load(saved)
    saved.write_bytes(content + b"\0")
    with pytest.raises(ValueError, match="checksum"):
        BoundaryMesh.load(saved)


def test_foreign_files(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(ValueError, match="not a boundary mesh"):
        BoundaryMesh.load(path)
    for name, says in (("none.h5", "no such file"), (".", "Is a directory")):
        with pytest.raises(ValueError, match=says):
            BoundaryMesh.load(tmp_path / name)
    with pytest.raises(ValueError, match="no regular file"):
        BoundaryMesh.load("/dev/null")


def seal(path):
    """The checksum of changed content, as it is documented: 512 bytes ahead of what it is taken of."""
    stored = path.read_bytes()
    version = stored.splitlines()[0]
    content = stored[512:]
    head = version + b"\nsha256 " + hashlib.sha256(content).hexdigest().encode() + b"\n"
    path.write_bytes(head.ljust(512, b"\n") + content)


def dataset(name, change):
    def edit(file):
        values = change(file[name][()])
        attributes = dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=values).attrs.update(attributes)

    return edit


def attribute(group, name, value):
    return lambda file: file[group].attrs.__setitem__(name, value)


def put(index, value):
    def change(values):
        values = values.copy()
        values[index] = value
        return values

    return change


nan = float("nan")
EDITS = {
    "nan gaps": (dataset("pairs/gap", put(3, nan)), "pair"),
    "negative gap": (dataset("pairs/gap", put(3, -1e-9)), "gap of contact pair 3 is -1e-09"),
    "too few gaps": (dataset("pairs/gap", lambda v: v[:3]), "boundary mesh: pairs"),
    "nan normals": (dataset("pairs/normal", put(2, nan)), "boundary mesh: pairs.normal"),
    "long normals": (dataset("pairs/normal", lambda v: 5 * v), "length of the normal of contact pair 0 is 5"),
    "a node with itself": (dataset("pairs/nodes", lambda v: 0 * v), "joins node 0 to itself"),
    "a node that is none": (dataset("pairs/nodes", put(0, 10**6)), "refers to number 1000000"),
    "nan position": (dataset("pairs/position", put(0, nan)), "boundary mesh: pairs.position"),
    "position beyond": (dataset("pairs/position", put(1, 3.0)), "position of contact pair 1 is 3"),
    "negative weight": (dataset("pairs/weight", put(1, -1.0)), "weight of contact pair 1 is -1"),
    "no weight": (dataset("pairs/weight", put(1, 0.0)), "weight of contact pair 1 is 0"),
    "crack that is none": (dataset("pairs/crack", put(1, 4)), "refers to number 4"),
    "nan centres": (
        dataset("scaling_centres", lambda v: nan * v),
        "scaling_centres holds numbers that are not finite",
    ),
    "centres elsewhere": (dataset("scaling_centres", lambda v: 9 + 0 * v), "not star-convex"),
    "nan nodes": (dataset("nodes", put(5, nan)), "nodes holds numbers that are not finite"),
    "nodes moved": (dataset("nodes", lambda v: v[::-1].copy()), "star-convex"),
    "edges in floats": (dataset("edges", lambda v: v.astype(float)), "whole numbers were expected"),
    "edges out of range": (dataset("edges", put((0, 0), -1)), "refers to number -1"),
    "marks of too few": (dataset("closed", lambda v: v[:-1]), "boundary mesh: element_start has the shape"),
    "weights in whole numbers": (
        dataset("pairs/weight", lambda v: np.ones(len(v), int)),
        "pairs.weight holds int64, floating-point numbers were expected",
    ),
    "truths in numbers": (dataset("closed", lambda v: v.astype(int)), "true and false were expected"),
    "starts that fall": (dataset("element_start", put(1, 0)), "do not fit together"),
    "no order": (lambda file: file.attrs.__setitem__("order", 0), "its order is 0"),
    "set out of range": (dataset("edge_sets/0", put(0, 10**6)), "edge set 'left' refers to"),
    "tip element": (attribute("tips/0", "element", 9999), "refers to number 9999, 0 to"),
    "tip element closed": (attribute("tips/0", "element", 0), "closed; an open one"),
    "crack's element": (attribute("cracks/0", "tip_element", 9999), "S-element 9999, 0 to"),
    "nan opening": (attribute("cracks/0", "opening", nan), "opening of crack 'crack1' is nan"),
    "tip a word": (attribute("cracks/0", "tip", "a"), "two finite numbers were expected"),
    "tip elsewhere": (attribute("tips/0", "position", (0.0, 0.0)), "not at the scaling centre"),
    "nan axis": (attribute("tips/0", "axis", (nan, nan)), "axis of tip 'crack1'"),
    "long axis": (attribute("cracks/0", "axis", (0.0, 2.0)), "axis of crack 'crack1' has the length 2"),
    "no length": (attribute("cracks/0", "length", -1.0), "length of crack 'crack1' is -1"),
    "larger than the file": (
        lambda file: (file.__delitem__("closed"), file.create_dataset("closed", (10**12,), bool)),
        "closed is larger than the file",
    ),
    "storage elsewhere": (
        lambda file: (
            file.__delitem__("closed"),
            file.create_dataset("closed", (8,), "u1", external=[("/etc/passwd", 0, 8)]),
        ),
        "closed is no data set of this file",
    ),
    "a link elsewhere": (
        lambda file: (
            file.__delitem__("closed"),
            file.__setitem__("closed", h5py.ExternalLink("other.h5", "closed")),
        ),
        "closed is no data set of this file",
    ),
    "no data set": (lambda file: file.__delitem__("closed"), "no boundary mesh of this version"),
    "order": (lambda file: file.attrs.__setitem__("order", 3), "was expected for order 3"),
}


@pytest.mark.parametrize("name", EDITS)
def test_files_that_were_changed_with_care(saved, name):
    """The checksum is right, the content is not."""
    edit, says = EDITS[name]
    with h5py.File(saved, "r+") as file:
        edit(file)
    with pytest.raises(ValueError, match="checksum"):
        BoundaryMesh.load(saved)
    seal(saved)
    with pytest.raises(ValueError) as caught:
        BoundaryMesh.load(saved)
    assert says in str(caught.value) and "mesh.h5" in str(caught.value) and "\n" not in str(caught.value)


def test_an_unchanged_file_sealed_again_is_read(saved):
    """So that the edits above are refused for what they changed."""
    with h5py.File(saved, "r+") as file:
        dataset("pairs/gap", lambda values: values)(file)
    seal(saved)
    assert same(MESH, BoundaryMesh.load(saved))


@pytest.mark.parametrize("path", [None, 1, 3.5, b"mesh.h5", [], "", "a\0b"])
@pytest.mark.parametrize("method", ["save", "load", "export"])
def test_paths_that_are_none(method, path):
    with pytest.raises(
        (TypeError, ValueError), match="path = .* (must be a string or a path|is no name of a file)"
    ):
        getattr(MESH, method)(path)


def test_places_that_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match="cannot be written"):
        MESH.save(tmp_path / "none" / "mesh.h5")
    with pytest.raises(ValueError, match="cannot be written"):
        MESH.export(tmp_path / "none" / "mesh.vtu")
    with pytest.raises(ValueError, match="cannot be exported"):
        MESH.export(tmp_path / "mesh.unknown")
    for method in (MESH.save, MESH.export):
        for target in ("/dev/null", tmp_path):
            with pytest.raises(ValueError, match="is (a folder|no regular file); name another one"):
                method(target)
    assert os.listdir(tmp_path) == [] and os.path.exists("/dev/null")


def test_links_are_followed_and_companions_do_not_replace_files(saved, tmp_path):
    (tmp_path / "link.h5").symlink_to(saved)
    MESH.save(tmp_path / "link.h5")
    assert (tmp_path / "link.h5").is_symlink() and same(MESH, BoundaryMesh.load(saved))
    with pytest.raises(ValueError, match=r"'mesh\.h5', which belongs to it, would replace"):
        MESH.export(tmp_path / "mesh.xdmf")  # meshio puts the numbers of a .xdmf into a .h5
    assert same(MESH, BoundaryMesh.load(saved))
    MESH.export(tmp_path / "other.xdmf")
    MESH.export(tmp_path / "other.xdmf")
    assert sorted(os.listdir(tmp_path)) == ["link.h5", "mesh.h5", "other.h5", "other.xdmf"]
    (tmp_path / "case.toml").write_text("mine")
    with pytest.raises(
        ValueError, match=r"save: path '.*case\.toml' would replace a file that holds no mesh"
    ):
        MESH.save(tmp_path / "case.toml")
    assert (tmp_path / "case.toml").read_text() == "mine"
    (tmp_path / "empty").touch()
    MESH.save(tmp_path / "empty")


FULL = """
import resource, signal, sys
from meshing import BoundaryMesh
mesh = BoundaryMesh.load(sys.argv[1])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # as a disk that is full after 3000 bytes
for method, target in ((mesh.save, "mesh.h5"), (mesh.save, "new.h5"), (mesh.export, "new.vtu")):
    try:
        method(target)
    except ValueError as error:
        print(error)
"""


@pytest.mark.slow
def test_a_full_disk_leaves_nothing_behind(saved):
    before = saved.read_bytes()
    run = subprocess.run(
        [sys.executable, "-B", "-c", FULL, str(saved)],  # no bytecode, which would be cut for good
        cwd=saved.parent,
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = run.stdout.splitlines()
    assert len(said) == 3 and run.stderr == ""
    assert all("cannot be" in line and "large" in line for line in said), said
    assert os.listdir(saved.parent) == ["mesh.h5"] and saved.read_bytes() == before


def test_summary():
    """Every line against numbers that were put in."""
    text = MESH.summary()
    for part in (
        "0.1 x 0.01 m: x 0 to 0.1, y 0 to 0.01",
        f"{MESH.elements} S-elements of order 2, {len(MESH.edges)} edges of ",
        f"{2 * len(MESH.nodes)} displacements",
        "material    material: ",
        "left: 0.01 m in ",
        "bottom: 0.1 m in ",
        "P: (0.05, 0.01) m",
        f"crack1: length 0.005 m, 1 tip, {len(MESH.pairs)} contact pairs, gaps ",
        "crack1: (0.03, 0.005) m, opening 0.05 deg, S-element ",
    ):
        assert part in text, part
    assert "\ncrack       none" in Beam(0.1, 0.01).mesh(order=1).summary()
