"""HDF5 results: what is written is read back, incomplete files are refused, two ranks write what one
writes.
"""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest

from sbfem_petsc.loads import EdgeLoad, PointForce
from sbfem_petsc.petsc import MPI
from sbfem_petsc.results import gather
from sbfem_petsc.results.hdf5 import check_output_folder, read_results, write_results
from tests.results.results_case import LOADS, on_ranks


def test_what_is_written_is_read_back(solved, tmp_path):
    mesh, model, modes, cases = solved
    path = str(tmp_path / "results.h5")
    loads = {
        "closing": LOADS["closing"],
        "opening": [PointForce("A", fy=-20.0), EdgeLoad("top", pressure=0.0)],
    }
    assert write_results(path, model, modes, cases, loads) == path
    found = read_results(path)
    assert os.listdir(tmp_path) == ["results.h5"]
    np.testing.assert_array_equal(found.mesh["nodes"], mesh.nodes)
    starts = np.concatenate([[0], np.cumsum(found.mesh["element_nodes_count"])])
    for element in range(mesh.elements):
        np.testing.assert_array_equal(
            found.mesh["element_nodes"][starts[element] : starts[element + 1]], mesh.element_nodes(element)
        )
    np.testing.assert_array_equal(found.mesh["scaling_centres"], mesh.scaling_centres)
    np.testing.assert_array_equal(found.mesh["closed"], mesh.closed)
    np.testing.assert_array_equal(found.mesh["pairs"]["nodes"], mesh.pairs.nodes)
    np.testing.assert_array_equal(found.mesh["cracks"]["crack1"]["tip"], mesh.cracks[0].tip)
    np.testing.assert_array_equal(found.modal["frequencies"], modes.frequencies)
    np.testing.assert_array_equal(found.modal["shapes"][2], modes.nodal(2))
    closing = found.static["closing"]
    np.testing.assert_array_equal(closing["displacement"], cases["closing"].field)
    np.testing.assert_array_equal(closing["contact_force"], cases["closing"].contact_force)
    assert closing["contact_resultant"] == cases["closing"].contact_resultant > 0.0
    np.testing.assert_array_equal(
        closing["stress_intensity"]["crack1"]["factors"], cases["closing"].stress_intensity["crack1"]
    )
    np.testing.assert_allclose(closing["stress_intensity"]["crack1"]["exponents"], 0.5, atol=1e-2)
    assert closing["loads"]["1"]["kind"] == "PointForce" and closing["loads"]["1"]["fy"] == 600.0
    assert found.static["opening"]["loads"]["2"]["edge_set"] == "top"
    assert found.inputs["materials"]["material"]["young"] == 70e9 and found.inputs["thickness"] == 1.0
    assert found.inputs["supports"]["1"]["where"] == "left"
    assert found.units["/static/closing/displacement"] == "m" and found.units["/modal/frequencies"] == "Hz"
    assert {"sbfem-petsc", "petsc", "slepc", "numpy"} <= set(found.versions)
    assert "4 modes" in repr(found) and "closing" in repr(found)


@pytest.mark.slow
def test_every_dataset_has_a_unit_and_a_description(serial_files):
    with h5py.File(serial_files / "results.h5") as file:
        seen = []
        file.visititems(
            lambda name, item: (
                seen.append((name, set(item.attrs))) if isinstance(item, h5py.Dataset) else None
            )
        )
        assert file.attrs["complete"]
    assert len(seen) > 40
    assert not [name for name, attributes in seen if not {"unit", "description"} <= attributes]


def test_petsc_options_are_recorded(solved, tmp_path):
    from sbfem_petsc.petsc import PETSc

    options = PETSc.Options()
    options["static_ksp_rtol"] = 1e-13
    try:
        write_results(str(tmp_path / "r.h5"), solved[1], static=solved[3]["opening"], loads=LOADS["opening"])
    finally:
        del options["static_ksp_rtol"]
    found = read_results(str(tmp_path / "r.h5"))
    assert float(found.options["static_ksp_rtol"]) == 1e-13
    assert list(found.static) == ["static"] and found.modal is None


@pytest.mark.long
def test_two_ranks_write_what_one_writes(serial_files, parallel_files):
    one, two = (read_results(str(folder / "results.h5")) for folder in (serial_files, parallel_files))
    assert one.units == two.units and two.inputs["ranks"] == 2
    for name in (
        "nodes",
        "scaling_centres",
        "closed",
        "element_nodes",
        "element_nodes_count",
        "element_materials",
    ):
        np.testing.assert_array_equal(one.mesh[name], two.mesh[name])
    np.testing.assert_allclose(two.modal["frequencies"], one.modal["frequencies"], rtol=1e-7)
    for a, b in zip(one.modal["shapes"], two.modal["shapes"]):
        assert (a * b).sum() ** 2 / ((a * a).sum() * (b * b).sum()) > 1.0 - 1e-10
    for name in LOADS:
        scale = np.abs(one.static[name]["displacement"]).max()
        np.testing.assert_allclose(
            two.static[name]["displacement"], one.static[name]["displacement"], atol=1e-7 * scale
        )
        np.testing.assert_array_equal(two.static[name]["active"], one.static[name]["active"])


@pytest.mark.slow
def test_files_that_are_missing_truncated_incomplete_or_foreign(serial_files, tmp_path):
    whole = (serial_files / "results.h5").read_bytes()
    with pytest.raises(ValueError, match="does not exist"):
        read_results(str(tmp_path / "none.h5"))
    for length in (0, 100, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.h5").write_bytes(whole[:length])
        with pytest.raises(ValueError, match="truncated, damaged or no HDF5 file|its end is missing"):
            read_results(str(tmp_path / "cut.h5"))
    (tmp_path / "changed.h5").write_bytes(whole)
    with h5py.File(tmp_path / "changed.h5", "a") as file:
        file["modal/frequencies"][1] *= 1.0 + 1e-12
    with pytest.raises(ValueError, match="its checksum"):
        read_results(str(tmp_path / "changed.h5"))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["complete"] = True
    with pytest.raises(ValueError, match="another kind"):
        read_results(str(tmp_path / "other.h5"))


def test_a_failed_write_leaves_the_old_file(solved, tmp_path, monkeypatch):
    path = tmp_path / "results.h5"
    path.write_text("old")

    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(h5py.Dataset, "write_direct", refuse)
    with pytest.raises(ValueError, match="cannot be written: No space left on device"):
        write_results(str(path), solved[1], solved[2], solved[3])
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["results.h5"]


@pytest.mark.long
def test_failures_are_known_to_all_ranks(tmp_path, parallel_files):
    (tmp_path / "file").write_text("")
    done = on_ranks(2, "fail", str(tmp_path))
    for rank in (0, 1):
        assert f"rank {rank}: results file" in done.stdout and "No space left on device" in done.stdout, (
            done.stderr
        )
    assert os.listdir(tmp_path) == ["file"]
    assert done.returncode != 0 and done.stderr.count(f"{tmp_path / 'file'}' cannot be made") == 1


def test_names_of_cases(solved, tmp_path):
    with pytest.raises(ValueError, match="without '/'"):
        write_results(str(tmp_path / "r.h5"), solved[1], static={"a/b": solved[3]["opening"]})
    with pytest.raises(ValueError, match="loads are given for"):
        write_results(
            str(tmp_path / "r.h5"), solved[1], static=solved[3], loads={"pulling": LOADS["opening"]}
        )
    assert os.listdir(tmp_path) == []


def test_output_folder(tmp_path):
    assert check_output_folder(str(tmp_path / "a" / "b"), MPI.COMM_WORLD) == str(tmp_path / "a" / "b")
    assert os.listdir(tmp_path / "a" / "b") == []
    (tmp_path / "file").write_text("")
    for name in ("file", "file/below"):
        with pytest.raises(ValueError, match="output folder .* cannot be made"):
            check_output_folder(str(tmp_path / name), MPI.COMM_WORLD)
    if os.geteuid():
        (tmp_path / "locked").mkdir(mode=0o500)
        with pytest.raises(ValueError, match="output folder .* cannot be written"):
            check_output_folder(str(tmp_path / "locked"), MPI.COMM_WORLD)


def test_streaming_in_small_slabs():
    numbers, values = np.array([0, 1, 3, 4, 6]), np.arange(10.0).reshape(5, 2)
    seen = []
    gather.stream(MPI.COMM_SELF, numbers, values, 7, lambda first, rows: seen.append((first, rows)), slab=3)
    assert [first for first, _ in seen] == [0, 3, 6]
    whole = np.concatenate([rows for _, rows in seen])
    np.testing.assert_array_equal(whole[numbers], values)
    assert (whole[[2, 5]] == 0.0).all()
