"""Output folders: what the program has not made there is never replaced or removed, nor read through
links.
"""

import html.parser
import os
import shutil

import numpy as np
import pytest

from meshing import Beam
from meshing.folder_index import INDEX, listed
from sbfem_petsc.output_folder import HeldFolder, make_output_folder
from sbfem_petsc.record.files import opened
from sbfem_petsc.record.found import Found
from sbfem_petsc.record.journal import Journal
from sbfem_petsc.study import rows
from sbfem_petsc.study.folder import new_results
from sbfem_petsc.writing import write_table
from tests.study.small_case import CASE, sbfem, written

# One analysis, with a picture and a table.
SHORT = CASE[: CASE.index("[analyses.frequencies]")] + (
    '[analyses.push]\nkind = "static"\nload = "push"\n[output]\npictures = true\ncsv = true\n'
)
ROWS = SHORT + '[sweep.parameters]\n"loads.push.fy" = [1.0, 2.0]\n'


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """Folder of a case with its results in out/ and those of its sweep in rows/."""
    folder = tmp_path_factory.mktemp("once")
    assert sbfem("run", written(folder, SHORT), "--output", folder / "out", "--quiet").code == 0
    path = written(folder, ROWS, "sweep.toml")
    assert sbfem("sweep", path, "--output", folder / "rows", "--quiet").code == 0
    return folder


@pytest.fixture
def folder(once, tmp_path):
    """A copy of it."""
    shutil.copytree(once, tmp_path / "copy")
    return tmp_path / "copy"


def contents(folder):
    """Everything in a folder: kinds, bytes and times."""
    found = {}
    for place in sorted(folder.rglob("*")):
        stat = place.lstat()
        data = place.read_bytes() if place.is_file() and not place.is_symlink() else None
        found[str(place.relative_to(folder))] = (stat.st_mode, stat.st_mtime_ns, stat.st_size, data)
    return found


COMMANDS = [("run", "case.toml", "analyses"), ("sweep", "sweep.toml", "rows")]


@pytest.mark.parametrize("replace", [(), ("--replace",)])
@pytest.mark.parametrize("command, case, parts", COMMANDS)
def test_a_folder_of_the_users_is_refused(command, case, parts, replace, tmp_path, monkeypatch):
    """The folder of the case itself, with folders and files named like those of a run."""
    written(tmp_path, SHORT if command == "run" else ROWS, case)
    (tmp_path / parts / "mine").mkdir(parents=True)
    for name in (f"{parts}/mine/notes.txt", f"{parts}/00000.rows", "summary.json", "results.h5", ".lock"):
        (tmp_path / name).write_text("mine")
    before = contents(tmp_path)
    monkeypatch.chdir(tmp_path)
    for output in (".", str(tmp_path)):
        done = sbfem(command, case, "--output", output, *replace)
        assert done.code == 2 and "which this program has not made there" in done.err, done.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("name", "replace"),
    [(name, ()) for name in ("analyses/notes.txt", "mine/a.txt")]
    + [pytest.param(name, (), marks=pytest.mark.long) for name in ("notes.txt", "pictures/mine.png", "run2")]
    + [
        ("notes.txt", ("--replace",)),
        pytest.param("analyses/notes.txt", ("--replace",), marks=pytest.mark.long),
    ],
)
def test_what_is_added_is_refused(folder, name, replace):
    """Also where it stands among what a run has made; away again, the run goes on."""
    place = folder / "out" / name
    place.parent.mkdir(exist_ok=True)
    place.write_text("mine")
    before = contents(folder / "out")
    done = sbfem("run", folder / "case.toml", "--output", folder / "out", *replace)
    assert done.code == 2 and repr(name.split("/")[0] if name.startswith("mine/") else name) in done.err
    assert contents(folder / "out") == before
    place.unlink()
    if name.startswith("mine/"):
        place.parent.rmdir()
    assert sbfem("run", folder / "case.toml", "--output", folder / "out", *replace).code == 0


def test_what_other_functions_save_there_is_listed(folder):
    """A mesh, and one in a format of several files, as results are; the run goes on and may replace them."""
    out = folder / "out"
    mesh = Beam(0.2, 0.01).mesh(order=2)
    for _ in range(2):
        mesh.save(out / "body.npz")
        mesh.export(out / "body.xdmf")
    assert {"body.npz", "body.xdmf", "body.h5"} <= listed(str(out))
    assert sbfem("run", folder / "case.toml", "--output", out).code == 0
    (out / "mine.npz").write_text("mine")
    with pytest.raises(ValueError, match="something that this program has not made stands in its place"):
        mesh.save(out / "mine.npz")
    assert sbfem("run", folder / "case.toml", "--output", out).code == 2
    (out / "mine.npz").unlink()


def test_replacing_removes_what_the_index_lists(folder):
    """Also a report and the pictures of analyses that the new case has not."""
    out = folder / "out"
    assert sbfem("report", out).code == 0
    assert {"report.html", "pictures/push_crack1.png", "tables/push.csv"} <= listed(str(out))
    other = SHORT.replace("analyses.push", "analyses.pull").replace("pictures = true", "pictures = false")
    path = written(folder, other)
    assert sbfem("run", path, "--output", out).code == 2
    assert sbfem("run", path, "--output", out, "--replace").code == 0
    made = {str(place.relative_to(out)) for place in out.rglob("*") if place.is_file()}
    assert not made & {
        "report.html",
        "pictures/push_crack1.png",
        "tables/push.csv",
        "analyses/push.h5",
    }
    assert made - {INDEX} <= listed(str(out))


def test_run_and_sweep_do_not_mix(folder):
    before = contents(folder / "out")
    done = sbfem("sweep", folder / "sweep.toml", "--output", folder / "out")
    assert done.code == 2 and "holds the results of a run" in done.err
    assert contents(folder / "out") == before


@pytest.mark.long
def test_an_index_that_is_cut_off_or_lies(folder):
    """A line that a kill has cut off is none, and names that lead elsewhere are none."""
    index = folder / "out" / INDEX
    with open(index, "ab") as file:
        file.write(b'\n"../case.toml"\n"/etc/passwd"\n[1]\n"a/../../case.toml"\n"analyses/pus')
    assert not {"../case.toml", "/etc/passwd", "a/../../case.toml"} & listed(str(folder / "out"))
    assert sbfem("run", folder / "case.toml", "--output", folder / "out", "--replace").code == 0
    assert (folder / "case.toml").exists()


def test_an_empty_folder_and_one_process(tmp_path):
    (tmp_path / "out").mkdir()
    first = HeldFolder(str(tmp_path / "out"))
    with pytest.raises(ValueError, match="another process is at work"):
        HeldFolder(str(tmp_path / "out"))
    first.close()
    HeldFolder(str(tmp_path / "out")).close()


LINKED = [
    "results.h5",
    "analyses/push.h5",
    "pictures/push_crack1.png",
    "tables/push.csv",
    INDEX,
    "run.json",
]


@pytest.mark.parametrize("kind", ["link", "dangling", "pipe"])
@pytest.mark.parametrize("name", LINKED)
def test_links_and_pipes_in_a_run(folder, name, kind):
    secret = folder / "secret"
    secret.write_text("secret")
    place = folder / "out" / name
    place.unlink()
    if kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(secret if kind == "link" else folder / "nothing")
    for replace in ((), ("--replace",)):
        done = sbfem("run", folder / "case.toml", "--output", folder / "out", *replace)
        assert done.code == 2 and os.path.basename(name) in done.err, done.err
    assert secret.read_text() == "secret" and not (folder / "nothing").exists()


@pytest.mark.parametrize("part", ["rows", "rows/00000.rows", "sweep.h5", "sweep.json"])
def test_links_in_a_sweep(folder, part):
    place, goal = folder / "rows" / part, folder / "goal"
    shutil.move(place, goal)
    place.symlink_to(goal)
    before = contents(goal) if goal.is_dir() else goal.read_bytes()
    done = sbfem("sweep", folder / "sweep.toml", "--output", folder / "rows")
    assert done.code == 2 and repr(part.split("/")[0])[:-1] in done.err
    assert (contents(goal) if goal.is_dir() else goal.read_bytes()) == before


def test_rows_are_not_written_through_links(tmp_path):
    """Of files that a run writes while it goes on, whatever the folder."""
    goal = tmp_path / "goal"
    goal.write_text("mine")
    (tmp_path / "a.rows").symlink_to(goal)
    with pytest.raises(ValueError, match="is a link"):
        rows.append(str(tmp_path / "a.rows"), rows.Row(0, "", 0.0))
    os.mkfifo(tmp_path / "p.journal")
    with pytest.raises(ValueError, match="no regular file"):
        Journal(str(tmp_path / "p.journal"), "history file", resume=False)
    assert goal.read_text() == "mine"


@pytest.mark.parametrize("kind", ["link", "pipe", "folder of pictures"])
def test_a_report_shows_nothing_through_links(folder, kind):
    """A stranger's results, with or without an index."""
    out, secret = folder / "out", folder / "secret"
    secret.mkdir()
    (secret / "push_x.png").write_bytes(b"secret")
    place = out / "pictures" / "push_x.png"
    if kind == "link":
        place.symlink_to(secret / "push_x.png")
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        shutil.rmtree(out / "pictures")
        (out / "pictures").symlink_to(secret)
    for _ in range(2):
        done = sbfem("report", out)
        assert done.code == 2 and "pictures" in done.err
        assert not (out / "report.html").exists()
        (out / INDEX).unlink(missing_ok=True)


def test_results_are_not_read_through_links(folder):
    """The names are chosen by the command, not by the user."""
    goal = folder / "results.h5"
    shutil.move(folder / "out" / "results.h5", goal)
    (folder / "out" / "results.h5").symlink_to(goal)
    for command in ("report", "plot", "info", "export"):
        done = sbfem(command, folder / "out", *(("--csv",) if command == "export" else ()))
        assert done.code == 2 and "is a link" in done.err, done.err
    shutil.move(goal, folder / "out" / "results.h5")
    (folder / "out" / "analyses" / "push.result.h5").symlink_to(folder / "case.toml")
    done = sbfem("plot", folder / "out")
    assert done.code == 2 and "push.result.h5" in done.err


@pytest.mark.parametrize("index", [True, False])
def test_plots_reports_and_exports_replace_nothing_of_the_users(folder, index):
    """Their default places, and those that are named."""
    out, mine = folder / "out", folder / "mine"
    shutil.rmtree(out / "pictures")
    for place in (out / "pictures", out / "export", mine):
        place.mkdir()
        (place / "push_crack1.png").write_text("mine")
        (place / "push.csv").write_text("mine")
    (out / "report.html").write_text("mine")
    if not index:
        (out / INDEX).unlink()
    else:
        lines = (out / INDEX).read_text().splitlines()
        (out / INDEX).write_text("\n".join(line for line in lines if "pictures" not in line))
    before = contents(folder)
    for command in (
        ("report", out),
        ("plot", out),
        ("plot", out, "--output", mine),
        ("export", out, "--csv"),
        ("export", out, "--csv", "--output", mine),
    ):
        done = sbfem(*command)
        assert done.code == 2 and "this program has" in done.err, (command, done.err)
    now = contents(folder)
    assert {name: now[name] for name in before if name != f"out/{INDEX}"} == {
        name: item for name, item in before.items() if name != f"out/{INDEX}"
    }


@pytest.mark.long
def test_commands_that_are_repeated_replace_their_own(folder):
    out, elsewhere = folder / "out", folder / "elsewhere"
    for _ in range(2):
        for command in (
            ("report", out),
            ("plot", out),
            ("plot", out, "--output", elsewhere / "pictures"),
            ("export", out, "--csv"),
            ("export", out, "--csv", "--output", elsewhere / "export"),
        ):
            done = sbfem(*command)
            assert done.code == 0, (command, done.err)
    assert sbfem("run", folder / "case.toml", "--output", out).code == 0


class Tags(html.parser.HTMLParser):
    """Tags of a page, their attributes and its text."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.text = set(), set(), []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.text.append(data)


EVIL = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>&amp;"


def test_nothing_of_a_strangers_file_becomes_part_of_a_page(folder):
    """Kind, names, reasons, units, texts, captions: all of it is text, once and whole."""
    out = folder / "out"
    source = out / "results.h5"
    with opened(source) as file:
        facts = file.attrs["run"].decode().replace('"small"', '"title%s"')
        with new_results(folder / "new.h5", "run") as new:
            case = new.create_group("case")
            case.create_group("files")
            case.attrs["file"] = "case.toml"
            case["text"] = np.frombuffer(f"case{EVIL}".encode(), np.uint8)
            escaped = EVIL.replace('"', '\\"')
            new.attrs["run"] = (facts % escaped).replace('"failed": {}', f'"failed": {{"a": "why{escaped}"}}')
            group = new.create_group("analyses", track_order=True)
            name = f"name{EVIL}".replace("/", "")
            Found.read(file["analyses/push"]).write(group.create_group(name))
            group[name].attrs["kind"] = f"kind{EVIL}\x1b"
            for data in group[name].values():
                if "units" in data.attrs:
                    data.attrs["units"] = f"unit{EVIL}"
    os.replace(folder / "new.h5", source)
    os.rename(out / "pictures" / "push_crack1.png", out / "pictures" / f"{name}_caption{name}.png")
    done = sbfem("report", out)
    assert done.code == 0, done.err
    page = Tags((out / "report.html").read_text(encoding="utf-8"))
    assert "script" not in page.tags and "onerror" not in page.attributes
    told = "".join(page.text)
    for item in ("title", "case", "why", "kind", "unit"):
        assert f"{item}{EVIL}" in told, item
    assert told.count(name) >= 2 and "\x1b" not in told


@pytest.mark.long
def test_results_of_a_case_that_names_files_elsewhere(tmp_path):
    """Those are kept with the results, from which it is drawn and exported without them; their names lead
    nowhere.
    """
    (tmp_path / "case" / "data").mkdir(parents=True)
    (tmp_path / "other").mkdir()
    places = ("data/wave.csv", "../other/wave.csv", str(tmp_path / "other" / "third.csv"))
    text = CASE[: CASE.index("[loads.push]")] + CASE[CASE.index("[output]") :]
    for k, place in enumerate(places):
        (tmp_path / "case" / place).write_text(f"time,value\n0,0\n1e-4,{k + 1.0}\n1,{k + 1.0}\n")
        signal = f'{{ kind = "samples", file = "{place}" }}'
        text += f'\n[loads.l{k}]\nkind = "point_force"\npoint = "A"\nfy = {signal}\n'
        text += f'[analyses.a{k}]\nkind = "load_history"\nload = "l{k}"\ntimes = [0.0, 0.5]\n'
    text = text.replace("pictures = false", "pictures = true")
    out = tmp_path / "out"
    done = sbfem("run", written(tmp_path / "case", text), "--output", out, "--quiet")
    assert done.code == 0, done.err
    before = contents(out / "pictures")
    shutil.rmtree(tmp_path / "case")
    shutil.rmtree(tmp_path / "other")
    for command in (("plot", out), ("export", out, "--csv"), ("report", out)):
        done = sbfem(*command)
        assert done.code == 0, done.err
    assert set(contents(out / "pictures")) == set(before) and len(before) == 3
    assert sorted(os.listdir(tmp_path)) == ["out"]


def test_failures_and_bytes_between_rows(tmp_path):
    """A later success takes the place of a failure, and a failure not that of a success; what is between the
    rows, or damaged, costs no other row.
    """
    for number, reason in ((0, "no luck"), (1, "")):
        rows.append(str(tmp_path / "00000.rows"), rows.Row(number, reason, 1.0))
        rows.append(str(tmp_path / "00001.rows"), rows.Row(number, "" if reason else "no luck", 2.0))
    found = rows.read(str(tmp_path))
    assert [found[k].reason for k in (0, 1)] == ["", ""]
    assert [found[k].seconds for k in (0, 1)] == [2.0, 1.0]
    path = tmp_path / "00002.rows"
    ends = [0]
    for number in range(2, 7):
        rows.append(str(path), rows.Row(number, "", float(number)))
        ends.append(path.stat().st_size)
    whole = path.read_bytes()
    for place in (*range(ends[1], ends[1] + 32), (ends[1] + ends[2]) // 2, ends[2] - 1, ends[4] + 5):
        damaged = bytearray(whole)
        damaged[place] ^= 0x11
        path.write_bytes(damaged)
        lost = 3 if place < ends[2] else 6
        assert sorted(rows.read(str(tmp_path))) == [k for k in range(7) if k != lost]
        assert path.read_bytes() == damaged
    path.write_bytes(whole[: ends[3] - 7])  # killed while it wrote, then gone on
    rows.append(str(path), rows.Row(6, "", 6.0))
    assert sorted(rows.read(str(tmp_path))) == [0, 1, 2, 3, 6]


def test_failed_rows_are_tried_again(tmp_path, monkeypatch):
    from sbfem_petsc.study.structure import Structure

    path, out, solve, asked = written(tmp_path, ROWS), tmp_path / "out", Structure.solve, []

    def failing(self, case, name, **options):
        fy = case.tables.loads["push"].fy
        asked.append(fy)
        if fy == 2.0 and len(asked) <= 2:
            raise ValueError("no luck")
        return solve(self, case, name, **options)

    monkeypatch.setattr(Structure, "solve", failing)
    done = sbfem("sweep", path, "--output", out, "--json", "--quiet")
    assert done.code == 3 and done.answer["failed"] == 1 and asked == [1.0, 2.0]
    done = sbfem("sweep", path, "--output", out, "--json", "--quiet")
    assert done.code == 0 and done.answer["failed"] == 0 and asked == [1.0, 2.0, 2.0]


def test_an_index_that_cannot_grow(tmp_path, monkeypatch):
    """What is not listed is not made: a line that a full disk cuts is told like one that it refuses."""
    make_output_folder(str(tmp_path / "out"))
    write = os.write
    monkeypatch.setattr(os, "write", lambda handle, data: write(handle, data[:-3]))
    place = str(tmp_path / "out" / "a.csv")
    with pytest.raises(ValueError, match=r"a\.csv' cannot be made \(No space left on device\); make room"):
        write_table(place, {"x": [1.0]})
    assert os.listdir(tmp_path / "out") == [INDEX] and not listed(str(tmp_path / "out"))
