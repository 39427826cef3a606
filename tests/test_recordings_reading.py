"""Reading tables: CSV, TSV, npz, HDF5; guesses, layouts, and files that are damaged or hostile."""

from __future__ import annotations

import io
import os
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.recorded import recording_of_a_spring
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.recordings import Layout, Recording, quaternions, read
from vic_toolbox.recordings.guessing import guess_columns

GOOD = recording_of_a_spring(seconds=0.3)


def columns_of(recording: Recording) -> dict[str, np.ndarray]:
    """Columns with names as people write them."""
    groups = {
        ("t",): recording.time[:, None],
        ("fx", "fy", "fz", "mx", "my", "mz"): recording.wrench,
        ("x", "y", "z"): recording.position,
        ("qw", "qx", "qy", "qz"): recording.quat_wxyz,
        ("x_des", "y_des", "z_des"): recording.reference_position,
        ("qw_des", "qx_des", "qy_des", "qz_des"): recording.reference_quat_wxyz,
    }
    return {name: table[:, i] for names, table in groups.items() for i, name in enumerate(names)}


def write_table(
    path: Path, columns: dict[str, np.ndarray], *, delimiter: str = ",", comment: str = ""
) -> Path:
    header = comment + delimiter.join(columns)
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        delimiter=delimiter,
        header=header,
        comments="",
        fmt="%.17g",
    )
    return path


def same(recording: Recording, other: Recording = GOOD, atol: float = 1e-12) -> bool:
    np.testing.assert_allclose(recording.wrench, other.wrench, atol=atol)
    np.testing.assert_allclose(recording.time, other.time, atol=atol)
    np.testing.assert_allclose(recording.error, other.error, atol=max(atol, 1e-12))
    return True


# --- text ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", "\t", ";", " "])
@pytest.mark.parametrize("comment", ["", "# "])
def test_a_text_table_is_read_and_the_guess_is_noted(tmp_path: Path, delimiter: str, comment: str):
    path = write_table(tmp_path / "log.csv", columns_of(GOOD), delimiter=delimiter, comment=comment)
    recording = read(path)
    assert same(recording)
    assert "guessed wrench = fx, fy, fz, mx, my, mz" in recording.notes
    assert "guessed reference_quat_wxyz = qw_des, qx_des, qy_des, qz_des" in recording.notes
    assert recording.source == str(path)


NAMES = {
    "kuka": "time f_x f_y f_z m_x m_y m_z x y z x0 y0 z0 u_x u_y u_z theta u0_x u0_y u0_z theta0",
    "ros": "header.stamp.secs wrench.force.x wrench.force.y wrench.force.z wrench.torque.x wrench.torque.y "
    "wrench.torque.z pose.position.x pose.position.y pose.position.z pose.orientation.x pose.orientation.y "
    "pose.orientation.z pose.orientation.w target_pose.position.x target_pose.position.y target_pose.position.z",
    "units": "Time[s] Fx[N] Fy[N] Fz[N] Tx[Nm] Ty[Nm] Tz[Nm] px[m] py[m] pz[m] pxd[m] pyd[m] pzd[m]",
    "camel": "timestamp forceX forceY forceZ torqueX torqueY torqueZ posX posY posZ posXRef posYRef posZRef "
    "roll pitch yaw",
    "slashes": "/time /ee/force/x /ee/force/y /ee/force/z /ee/pos/x /ee/pos/y /ee/pos/z /ref/pos/x /ref/pos/y "
    "/ref/pos/z q1 q2 q3 q4 q5 q6 q7 dq1 dq2 dq3 dq4 dq5 dq6 dq7",
}


@pytest.mark.parametrize("style", NAMES)
def test_names_of_many_styles_are_understood(style: str):
    names = NAMES[style].split()
    fields = guess_columns(names)
    assert fields["time"] == (names[0],)
    assert len(fields["wrench"]) in (3, 6)
    assert fields["wrench"][0] == names[1]
    assert len(fields["position"]) == len(fields["reference_position"]) == 3
    used = [name for columns in fields.values() for name in columns]
    assert len(used) == len(set(used))
    assert set(used) == set(names)


def test_names_that_say_nothing_are_left_alone():
    assert guess_columns(["battery", "x_battery", "camera.x", "0", "", "w", "q0_des", "é", "fx" * 5000]) == {}


def test_joints_are_numbered_in_any_way():
    names = [f"joint_{i:02d}" for i in range(12)][::-1]
    assert guess_columns(names) == {"joint_position": tuple(names[::-1])}
    assert guess_columns(["joint_²", "joint_٣"]) == {}


def test_a_layout_says_what_is_what(tmp_path: Path):
    turned = GOOD.quat_wxyz[:, [1, 2, 3, 0]]
    columns = {
        "tick": 1e3 * GOOD.time,
        **{f"s{i}": -GOOD.wrench[:, i] for i in range(6)},
        **{f"p{i}": 1e3 * GOOD.position[:, i] for i in range(3)},
        **{f"o{i}": turned[:, i] for i in range(4)},
        **{f"r{i}": 1e3 * GOOD.reference_position[:, i] for i in range(3)},
        **{f"a{i}": np.degrees(quaternions.log(GOOD.reference_quat_wxyz)[:, i]) for i in range(3)},
    }
    path = write_table(tmp_path / "log.csv", columns)
    toml = tmp_path / "layout.toml"
    toml.write_text(
        """
        wrench_sign = -1
        [columns]
        time = "tick"
        wrench = ["s0", "s1", "s2", "s3", "s4", "s5"]
        position = ["p0", "p1", "p2"]
        quat_xyzw = ["o0", "o1", "o2", "o3"]
        reference_position = ["r0", "r1", "r2"]
        reference_rotation_vector = ["a0", "a1", "a2"]
        [units]
        time = "ms"
        length = "mm"
        angle = "deg"
        """
    )
    recording = read(path, toml)
    assert same(recording)
    assert recording.notes == ()
    assert same(read(path, Layout.load(toml)))
    assert same(
        read(
            path,
            {"columns": Layout.load(toml).columns, "units": dict(Layout.load(toml).units)},
            wrench_sign=-1,
        )
    )


def test_the_sensors_frame_is_stated_when_reading(tmp_path: Path):
    q = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    from vic_toolbox.recordings import wrench_to_world

    path = write_table(tmp_path / "log.csv", columns_of(wrench_to_world(GOOD, rotation=q.T)))
    assert same(read(path, sensor_rotation=q))
    inverse = quaternions.conjugate(GOOD.quat_wxyz)
    sensor = quaternions.rotate_halves(inverse, GOOD.wrench).reshape(-1, 2, 3) @ q
    logged = columns_of(GOOD) | {
        n: sensor.reshape(-1, 6)[:, i] for i, n in enumerate(("fx", "fy", "fz", "mx", "my", "mz"))
    }
    path = write_table(tmp_path / "tool.csv", logged)
    assert same(read(path, wrench_axes="tool", sensor_rotation=q))


@pytest.mark.parametrize(
    ("kind", "make"),
    [
        ("axis_angle", lambda v: np.column_stack([(v.T / np.linalg.norm(v, axis=1)).T, np.linalg.norm(v, axis=1)])),
        ("rotation_vector", lambda v: v),
        ("quat_wxyz", quaternions.exp),
        ("quat_xyzw", lambda v: quaternions.exp(v)[:, [1, 2, 3, 0]]),
    ],
)  # fmt: skip
def test_orientations_in_every_form(tmp_path: Path, kind: str, make):
    vectors = np.random.default_rng(0).normal(size=(len(GOOD), 3))
    values = make(vectors)
    extra = {f"a{i}": values[:, i] for i in range(values.shape[1])}
    path = write_table(tmp_path / "log.csv", columns_of(GOOD) | extra)
    recording = read(path, {"columns": {kind: tuple(extra)}})
    np.testing.assert_allclose(recording.quat_wxyz, quaternions.exp(vectors), atol=1e-12)


def test_roll_pitch_yaw_turns_about_x_then_y_then_z(tmp_path: Path):
    rpy = np.random.default_rng(0).normal(size=(len(GOOD), 3))
    columns = {n: v for n, v in columns_of(GOOD).items() if not n.startswith("q")}
    path = write_table(
        tmp_path / "log.csv", columns | dict(zip(("roll", "pitch", "yaw"), rpy.T, strict=True))
    )
    turns = [quaternions.exp(rpy[:, [i]] * np.eye(3)[i]) for i in range(3)]
    expected = quaternions.multiply(quaternions.multiply(turns[2], turns[1]), turns[0])
    recording = read(path)
    np.testing.assert_allclose(recording.quat_wxyz, expected, atol=1e-12)
    assert "no reference orientation in the log: the rotational error is zero here" in recording.notes
    np.testing.assert_allclose(recording.error[:, 3:], 0, atol=1e-12)


def test_what_is_missing_is_named_with_what_there_is(tmp_path: Path):
    columns = columns_of(GOOD)
    path = write_table(tmp_path / "log.csv", columns)
    with pytest.raises(
        InputError, match=r"no column 'FX' for wrench; there are: t, fx, .* The nearest is 'fx'"
    ):
        read(path, {"columns": {"wrench": ("FX", "fy", "fz")}})
    with pytest.raises(InputError, match=r"wrench has 2 columns \(fx, fy\); it needs 3 or 6"):
        read(path, {"columns": {"wrench": ("fx", "fy")}})
    with pytest.raises(InputError, match="no column was recognised as wrench"):
        read(write_table(tmp_path / "a.csv", {n: v for n, v in columns.items() if n != "fy"}))
    bare = {n: v for n, v in columns.items() if "des" not in n}
    path = write_table(tmp_path / "b.csv", bare)
    with pytest.raises(InputError, match="choose reference 'start' or 'mean'"):
        read(path)
    for reference, expected in (("start", GOOD.position[0]), ("mean", GOOD.position.mean(axis=0))):
        np.testing.assert_allclose(read(path, reference=reference).reference_position[7], expected)
    path = write_table(tmp_path / "c.csv", {n: v for n, v in columns.items() if n != "t"})
    with pytest.raises(InputError, match="state the rate"):
        read(path)
    assert read(path, rate=1000.0).rate == pytest.approx(1000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("colums = {}", "key of the layout is 'colums'; choose one of: columns"),
        ("[columns]\nforce = ['a']", "field of columns is 'force'"),
        ("[columns]\nwrench = [1, 2, 3]", "write their names"),
        ("[units]\nlength = 'inch'", "unit of length is 'inch'; choose one of: m, mm, cm"),
        ("[topics]\nwrench = 3", "the topic of wrench is 3"),
        ("columns = 3", "write a table of names"),
        ("wrench_sign = 2", "must be 1 or -1"),
        ("wrench_axes = 'base'", "choose one of: world, tool"),
        ("sensor_rotation = [[1, 0], [0, 1]]", "sensor_rotation has shape"),
        ("rate = -1", "rate is -1"),
        ("a = [", "cannot be read as TOML"),
    ],
)
def test_layouts_that_say_nonsense_are_refused(tmp_path: Path, content: str, message: str):
    (tmp_path / "a.toml").write_text(content)
    with pytest.raises((InputError, FileError), match=message):
        Layout.load(tmp_path / "a.toml")


def test_empty_cells_become_findings(tmp_path: Path):
    path = write_table(tmp_path / "log.csv", columns_of(GOOD))
    lines = path.read_text().splitlines()
    cells = lines[51].split(",")
    cells[3] = ""
    lines[51] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    recording = read(path)
    assert recording.findings[0].kind == "nan"
    assert recording.findings[0].index == 50
    assert len(read(path, repair=True)) == len(GOOD) - 1


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda text: "", "is empty"),
        (lambda text: "\n\n#\n", "is empty"),
        (lambda text: text.splitlines()[0] + "\n", "no numbers"),
        (
            lambda text: text[: len(text) // 2].rsplit(",", 3)[0],
            r"line \d+: \d+ cells where there are 21 columns.*cut off",
        ),
        (lambda text: text.replace(",", ";").replace(".", ","), "write a point for the decimal comma"),
        (lambda text: "\n".join(text.splitlines()[1:]), "begins with numbers"),
        (lambda text: text.replace("fy", "fx", 1), "more than one column called fx"),
        (lambda text: text + "1,2,3\n" + text.splitlines()[1] + "\n", "line 302: 3 cells"),
        (lambda text: text + text, "line 302: t is 't', not a number"),
        (lambda text: "x" * 200_000, "no column|more than 65536 characters"),
    ],
)
def test_damaged_tables_give_one_clear_line(tmp_path: Path, edit, message: str):
    path = write_table(tmp_path / "log.csv", columns_of(GOOD))
    path.write_text(edit(path.read_text()))
    with pytest.raises((FileError, InputError), match=message) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_a_last_line_that_breaks_off_is_left_out_when_asked(tmp_path: Path):
    path = write_table(tmp_path / "log.csv", columns_of(GOOD))
    path.write_text(path.read_text()[:-200])
    with pytest.raises(FileError, match="cut off"):
        read(path)
    assert len(read(path, repair=True)) == len(GOOD) - 1


@pytest.mark.parametrize(
    "content", [b"\0" * 100, bytes(range(256)) * 10, b"\xff\xfe" + "t,fx".encode("utf-16-le")]
)
def test_binary_garbage_is_no_text(tmp_path: Path, content: bytes):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(FileError, match="no text"):
        read(tmp_path / "a.csv")


def test_files_that_are_not_there(tmp_path: Path):
    with pytest.raises(FileError, match="cannot be opened"):
        read(tmp_path / "none.csv")
    with pytest.raises(FileError, match="a folder without a ROS 2 bag"):
        read(tmp_path)
    with pytest.raises(FileError, match="cannot be opened"):
        read("a\0b")


# --- npz and HDF5 --------------------------------------------------------------------------------------------


def arrays_of(recording: Recording) -> dict[str, np.ndarray]:
    return {
        "time": recording.time,
        "force": recording.wrench[:, :3],
        "torque": recording.wrench[:, 3:],
        "position": recording.position,
        "quat_xyzw": recording.quat_wxyz[:, [1, 2, 3, 0]],
        "position_ref": recording.reference_position,
        "ref_quat_wxyz": recording.reference_quat_wxyz,
        "comment": np.array(["by hand"]),
        "calibration": np.eye(3),
    }


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_files_of_arrays_are_read(tmp_path: Path, suffix: str):
    path = tmp_path / f"log{suffix}"
    content = arrays_of(GOOD)
    if suffix == ".npz":
        np.savez(path, **content)  # type: ignore[arg-type]
    else:
        with h5py.File(path, "w") as file:
            for name, array in content.items():
                if array.dtype.kind == "f":
                    file[f"robot/{name}"] = array
    recording = read(path)
    assert same(recording)
    assert any("left out, of another length than 300: " in note for note in recording.notes)


def test_homogeneous_poses_are_read(tmp_path: Path):
    from vic_toolbox.spatial import pose_from, quat_wxyz_to_rotation

    pose = pose_from(GOOD.position, quat_wxyz_to_rotation(GOOD.quat_wxyz))
    wanted = pose_from(GOOD.reference_position, quat_wxyz_to_rotation(GOOD.reference_quat_wxyz))
    np.savez(tmp_path / "a.npz", time=GOOD.time, wrench=GOOD.wrench, pose=pose, pose_desired=wanted)
    assert same(read(tmp_path / "a.npz"), atol=1e-9)
    np.savez(tmp_path / "b.npz", time=GOOD.time, wrench=GOOD.wrench, pose=2 * pose, pose_desired=wanted)
    with pytest.raises(FileError, match="holds no poses"):
        read(tmp_path / "b.npz")


def test_an_array_may_be_named_as_a_whole(tmp_path: Path):
    np.savez(tmp_path / "a.npz", tt=GOOD.time, ati=GOOD.wrench, p=GOOD.position, goal=GOOD.reference_position)
    layout = {"columns": {"time": "tt", "wrench": "ati", "position": "p", "reference_position": "goal"}}
    recording = read(tmp_path / "a.npz", layout)
    np.testing.assert_array_equal(recording.wrench, GOOD.wrench)


class Exploit:
    """What a pickle would run."""

    def __reduce__(self):
        return (Path.touch, (Path("exploited"),))


def test_objects_in_npz_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    np.savez("a.npz", time=np.array([Exploit()], dtype=object), allow_pickle=True)
    with pytest.raises(FileError, match="Python objects"):
        read("a.npz")
    assert not Path("exploited").exists()


def test_an_npz_that_claims_terabytes_is_refused_before_memory_is_taken(tmp_path: Path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("time.npy", header.getvalue() + b"\0" * 80)
    with pytest.raises(FileError, match="cut off"):
        read(tmp_path / "a.npz")


def test_an_npz_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("files", "recordings.arrays"):
        monkeypatch.setattr(f"vic_toolbox.{module}.LARGEST_BYTES", 1 << 20)
    np.savez_compressed(tmp_path / "a.npz", time=np.zeros(1 << 18))
    with pytest.raises(FileError, match="too much for one file"):
        read(tmp_path / "a.npz")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset(
            "time", shape=(10**12,), dtype="f8", chunks=(1000,)
        )  # a kilobyte that claims 8 TB
    with pytest.raises(FileError, match="too much for one recording"):
        read(tmp_path / "a.h5")


def test_hdf5_does_not_reach_out_of_its_file(tmp_path: Path):
    secret = tmp_path / "secret.bin"
    np.arange(300.0).tofile(secret)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["time"] = GOOD.time
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = h5py.ExternalLink("other.h5", "time")
        file["loop"] = h5py.SoftLink("/")
        file.create_dataset("fx", shape=(300,), dtype="f8", external=[(str(secret), 0, 2400)])
    with pytest.raises(FileError, match="holds no arrays of numbers"):
        read(tmp_path / "a.h5")


def test_groups_of_hdf5_that_contain_each_other(tmp_path: Path):
    """Hard links in a circle: eight groups in each other make 8¹⁶ paths."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        groups = [
            file.create_group(name)
            for name in ["robot", "arm", "tool", "base", "world", "sensor", "data", "state"]
        ]
        for group in groups:
            for other in (*groups, file):
                group[f"to{other.name}".replace("/", "_")] = other
        for name, array in arrays_of(GOOD).items():
            if array.dtype.kind == "f":
                groups[0][name] = array
    assert same(read(tmp_path / "a.h5"))


def test_every_error_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    columns = columns_of(GOOD)
    path = write_table(tmp_path / "nan.csv", columns | {"fx": np.full(len(GOOD), np.nan)})
    with pytest.raises(InputError, match=r"nan\.csv: no sample is left"):
        read(path, repair=True)
    monkeypatch.setattr(np, "loadtxt", lambda *_, **__: (_ for _ in ()).throw(MemoryError))
    with pytest.raises(FileError, match=r"nan\.csv does not fit into memory"):
        read(path)


def test_a_small_table_takes_little_memory(tmp_path: Path):
    """The rows that a file could hold at most are not allocated beforehand."""
    tracemalloc.start()
    read(write_table(tmp_path / "a.csv", columns_of(GOOD)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


@pytest.mark.parametrize("value", [1e308, -1e200, np.inf])
def test_absurd_numbers_are_findings_and_no_warnings(tmp_path: Path, value: float):
    from vic_toolbox.spatial import pose_from, quat_wxyz_to_rotation

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("t", "fx", "x", "qw", "x_des"):
            columns = {n: column.copy() for n, column in columns_of(GOOD).items()}
            columns[name][[3, 4]] = value, -value
            recording = read(write_table(tmp_path / f"{name}.csv", columns))
            assert recording.findings[0].severity == "error"
            assert str(len(recording)) in repr(recording)
            assert len(recording.plot().axes) == 6
        pose = pose_from(GOOD.position, quat_wxyz_to_rotation(GOOD.quat_wxyz))
        pose[5, 0, 0] = value
        np.savez(tmp_path / "a.npz", time=GOOD.time, wrench=GOOD.wrench, pose=pose, pose_desired=pose)
        with pytest.raises(FileError, match="holds no poses"):
            read(tmp_path / "a.npz")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipes_are_refused_at_once(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match="a device or a pipe"):
        read(tmp_path / "pipe")


# --- damage at random ----------------------------------------------------------------------------------------


def _files(tmp_path: Path) -> dict[str, bytes]:
    write_table(tmp_path / "a.csv", columns_of(GOOD))
    np.savez(tmp_path / "a.npz", **arrays_of(GOOD))  # type: ignore[arg-type]
    GOOD.save(tmp_path / "b.npz")
    return {name: (tmp_path / name).read_bytes() for name in ("a.csv", "a.npz", "b.npz")}


def outcome(path: Path, *, repair: bool = False) -> str:
    """What is wrong with a file, in the words of the error or of the findings."""
    try:
        return " ".join(map(str, read(path, repair=repair).findings))
    except (FileError, InputError) as error:
        return str(error)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_never_gives_more_than_one_clear_line(tmp_path: Path, data: st.DataObject):
    name, content = data.draw(st.sampled_from(sorted(_files(tmp_path).items())))
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(0, 6))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    damaged = damaged[: data.draw(st.integers(0, len(damaged)))]
    path = tmp_path / f"damaged-{name}"
    path.write_bytes(damaged)
    assert "\n" not in outcome(path, repair=data.draw(st.booleans()))
