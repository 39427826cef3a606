"""Bags: ROS 1, ROS 2 in SQLite and MCAP, written with the libraries and read back; and bags that are damaged."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.recorded import recording_of_a_spring
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.recordings import quaternions, read
from vic_toolbox.recordings.bags import choose_topics
from vic_toolbox.recordings.messages import decode, kind_of

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
GOOD = recording_of_a_spring(seconds=0.5)
START = 1_700_000_000_000_000_000
JOINTS = [f"joint_{i}" for i in range(7)]
Message = tuple[str, str, int, Any]
"""Topic, type, time [ns], message."""


def header(store: Any, nanoseconds: int, frame: str) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
    sequence = {"seq": 0} if store is ROS1 else {}
    return store.types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id=frame)


def messages(store: Any, *, pose_every: int = 1, arrival: int = 0, stamped: bool = True) -> list[Message]:
    """The recording as messages: wrench and joints at 1 kHz, poses slower, a reference, something else."""
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    point, pose = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Pose"]
    found: list[Message] = []

    def add(topic: str, kind: str, at: int, *content: Any) -> None:
        head = (header(store, at if stamped else 0, "base_link"),)
        found.append((topic, kind, at + arrival, types[kind](*head, *content)))

    def as_pose(position: np.ndarray, quat: np.ndarray) -> Any:
        return pose(point(*map(float, position)), quaternion(*map(float, quat[[1, 2, 3, 0]])))

    for i, time in enumerate(GOOD.time):
        at = START + round(time * 1e9)
        w = list(map(float, GOOD.wrench[i]))
        wrench = types["geometry_msgs/msg/Wrench"](vector(*w[:3]), vector(*w[3:]))
        add("/ft_sensor/wrench", "geometry_msgs/msg/WrenchStamped", at, wrench)
        joints = np.arange(7) + time, np.full(7, 0.1), np.zeros(0)
        add("/joint_states", "sensor_msgs/msg/JointState", at, JOINTS, *joints)
        if i % pose_every == 0 or i == len(GOOD) - 1:
            reference = as_pose(GOOD.reference_position[i], GOOD.reference_quat_wxyz[i])
            add("/ee_pose", "geometry_msgs/msg/PoseStamped", at, as_pose(GOOD.position[i], GOOD.quat_wxyz[i]))
            add("/ee_pose_desired", "geometry_msgs/msg/PoseStamped", at, reference)
    found.append(("/rosout", "std_msgs/msg/String", START, types["std_msgs/msg/String"]("hello")))
    return found


def write_ros1(path: Path, found: Iterable[Message], compression: Any = None) -> Path:
    path = path.with_suffix(".bag")
    with_compression = Writer1(path)
    if compression is not None:
        with_compression.set_compression(compression)
    with with_compression as bag:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in found:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=ROS1)
            bag.write(connections[topic], time, ROS1.serialize_ros1(message, kind))
    return path


def write_ros2(
    path: Path, found: Iterable[Message], plugin: StoragePlugin, mode: CompressionMode | None = None
) -> Path:
    bag = Writer2(path, version=9, storage_plugin=plugin)
    if mode is not None:
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in found:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=ROS2)
            bag.write(connections[topic], time, ROS2.serialize_cdr(message, kind))
    return path


def write_mcap(
    path: Path, found: Iterable[Message], compression: CompressionType, *, ros1: bool = False
) -> Path:
    path = path.with_suffix(".mcap")
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=20_000, compression=compression)
        writer.start(profile="ros1" if ros1 else "ros2")
        channels: dict[str, int] = {}
        for topic, kind, time, message in found:
            name = kind.replace("/msg/", "/") if ros1 else kind
            if topic not in channels:
                schema = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", b"never compiled")
                channels[topic] = writer.register_channel(topic, "ros1" if ros1 else "cdr", schema)
            data = ROS1.serialize_ros1(message, kind) if ros1 else ROS2.serialize_cdr(message, kind)
            writer.add_message(channels[topic], log_time=time, publish_time=time, data=bytes(data))
        writer.finish()
    return path


WRITERS: dict[str, Callable[..., Path]] = {
    "ros1": lambda path, **o: write_ros1(path, messages(ROS1, **o)),
    "ros1-bz2": lambda path, **o: write_ros1(path, messages(ROS1, **o), Writer1.CompressionFormat.BZ2),
    "ros1-lz4": lambda path, **o: write_ros1(path, messages(ROS1, **o), Writer1.CompressionFormat.LZ4),
    "ros2-sqlite": lambda path, **o: write_ros2(path, messages(ROS2, **o), StoragePlugin.SQLITE3),
    "ros2-mcap": lambda path, **o: write_ros2(path, messages(ROS2, **o), StoragePlugin.MCAP),
    "mcap": lambda path, **o: write_mcap(path, messages(ROS2, **o), CompressionType.NONE),
    "mcap-lz4": lambda path, **o: write_mcap(path, messages(ROS2, **o), CompressionType.LZ4),
    "mcap-zstd": lambda path, **o: write_mcap(path, messages(ROS2, **o), CompressionType.ZSTD),
    "mcap-ros1": lambda path, **o: write_mcap(path, messages(ROS1, **o), CompressionType.ZSTD, ros1=True),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_bag_is_read_back(tmp_path: Path, kind: str):
    recording = read(WRITERS[kind](tmp_path / "log"))
    np.testing.assert_array_equal(recording.wrench, GOOD.wrench)
    np.testing.assert_allclose(recording.time, GOOD.time, atol=1e-9)
    np.testing.assert_allclose(recording.position, GOOD.position, atol=1e-12)
    np.testing.assert_allclose(recording.error, GOOD.error, atol=1e-9)
    assert recording.joint_position is not None
    np.testing.assert_allclose(recording.joint_position, np.arange(7) + GOOD.time[:, None], atol=1e-12)
    assert recording.joint_velocity is not None
    assert (recording.joint_velocity == 0.1).all()
    assert any("wrench = /ft_sensor/wrench (geometry_msgs/" in note for note in recording.notes)
    assert recording.findings == ()


def test_the_one_file_of_a_folder_is_read_alone(tmp_path: Path):
    for plugin, suffix in ((StoragePlugin.SQLITE3, "db3"), (StoragePlugin.MCAP, "mcap")):
        folder = write_ros2(tmp_path / suffix, messages(ROS2), plugin)
        (file,) = folder.glob(f"*.{suffix}")
        np.testing.assert_array_equal(read(file).wrench, GOOD.wrench)


def test_topics_at_different_rates_come_onto_the_clock_of_the_wrench(tmp_path: Path):
    recording = read(WRITERS["ros1"](tmp_path / "log", pose_every=10))
    np.testing.assert_array_equal(recording.wrench, GOOD.wrench)
    np.testing.assert_allclose(recording.error[:, :3], GOOD.error[:, :3], atol=1e-4)  # 100 Hz, up to 3 Hz
    np.testing.assert_allclose(recording.error[:, 3:], GOOD.error[:, 3:], atol=1e-4)


def test_other_clocks(tmp_path: Path):
    path = WRITERS["mcap"](tmp_path / "log", pose_every=10)
    slow = read(path, clock="pose")
    assert slow.rate == pytest.approx(100)
    np.testing.assert_allclose(slow.wrench, GOOD.wrench[[*range(0, 500, 10), 499]], atol=1e-9)
    even = read(path, clock=250.0)
    assert even.rate == pytest.approx(250)
    np.testing.assert_allclose(even.wrench, GOOD.wrench[:-1:4], atol=1e-6)
    with pytest.raises(InputError, match="clock is 'joints'"):
        read(path, clock="joints")


def test_stamps_of_the_header_or_of_arrival(tmp_path: Path):
    late = WRITERS["ros2-mcap"](tmp_path / "late", arrival=7_000_000)
    assert read(late).time[-1] == pytest.approx(GOOD.time[-1])
    without = read(WRITERS["ros2-mcap"](tmp_path / "without", stamped=False))
    np.testing.assert_allclose(without.time, GOOD.time, atol=1e-9)
    assert any("no times in its messages" in note for note in without.notes)


def test_a_reference_that_is_published_once_is_held(tmp_path: Path):
    found = messages(ROS2)
    first = next(message for message in found if message[0] == "/ee_pose_desired")
    kept = [message for message in found if message[0] != "/ee_pose_desired"]
    path = write_mcap(tmp_path / "log", [*kept[:200], first, *kept[200:]], CompressionType.NONE)
    recording = read(path)
    assert len(recording) == len(GOOD)
    np.testing.assert_allclose(
        recording.reference_position, np.tile(GOOD.reference_position[0], (len(GOOD), 1))
    )


def test_gaps_of_the_pose_are_not_bridged(tmp_path: Path):
    missing = range(START + 100_000_000, START + 300_000_000)
    found = [m for m in messages(ROS2) if not (m[0] == "/ee_pose" and m[2] in missing)]
    recording = read(write_mcap(tmp_path / "log", found, CompressionType.NONE))
    assert len(recording) == len(GOOD) - 200
    assert recording.findings[0].kind == "gap"
    assert any("left out 200 samples in gaps of /ee_pose" in note for note in recording.notes)


# --- topics --------------------------------------------------------------------------------------------------


def test_topics_that_are_not_there(tmp_path: Path):
    path = WRITERS["ros1"](tmp_path / "log")
    with pytest.raises(
        InputError, match=r"no topic '/ft/wrench' for wrench; .* The nearest is '/ft_sensor/wrench'"
    ):
        read(path, topics={"wrench": "/ft/wrench"})
    with pytest.raises(InputError, match="/ee_pose is geometry_msgs/msg/PoseStamped, which is no wrench"):
        read(path, topics={"wrench": "/ee_pose"})
    with pytest.raises(InputError, match="field of topics is 'force'"):
        read(path, topics={"force": "/ee_pose"})
    found = [message for message in messages(ROS1) if "wrench" not in message[0]]
    with pytest.raises(InputError, match=r"no topic that could be the wrench; the topics are: /ee_pose \("):
        read(write_ros1(tmp_path / "none", found))
    found = [message for message in messages(ROS1) if "desired" not in message[0]]
    path = write_ros1(tmp_path / "free", found)
    with pytest.raises(InputError, match="no topic that could be the reference"):
        read(path)
    assert len(read(path, reference="start")) == len(GOOD)


def test_topics_are_chosen_by_type_and_name():
    pose, wrench = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/WrenchStamped"
    types = {"/a": pose, "/target": pose, "/w1": wrench, "/w2": wrench, "/s": "std_msgs/msg/String"}
    with pytest.raises(InputError, match="/w1, /w2 could all be the wrench"):
        choose_topics("bag", types, {})
    assert choose_topics("bag", types, {"wrench": "/w2"}) == {
        "wrench": "/w2",
        "pose": "/a",
        "reference": "/target",
    }
    stated = {"wrench": "/w1", "pose": "/target", "reference": "/a"}
    assert choose_topics("bag", types, stated) == stated


def test_joints_of_another_source_are_left_out(tmp_path: Path):
    state = ROS2.types["sensor_msgs/msg/JointState"]
    finger = [
        ("/joint_states", "sensor_msgs/msg/JointState", START + i * 10**7, state(
            header(ROS2, START + i * 10**7, ""), ["finger"], np.zeros(1), np.zeros(1), np.zeros(1)))
        for i in range(50)
    ]  # fmt: skip
    recording = read(write_mcap(tmp_path / "log", [*messages(ROS2), *finger], CompressionType.NONE))
    assert recording.joint_position is not None
    assert recording.joint_position.shape == (len(GOOD), 7)
    assert any("left out 50 messages of /joint_states" in note for note in recording.notes)


# --- messages ------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(
    frame=st.text(max_size=20).filter(lambda text: "\0" not in text),
    stamp=st.integers(1, 2**31 - 1),
    numbers=st.lists(st.floats(allow_nan=False), min_size=7, max_size=7),
    ros2=st.booleans(),
    big=st.booleans(),
)
def test_messages_are_decoded_as_the_library_decodes_them(frame, stamp, numbers, ros2, big):
    store = ROS2 if ros2 else ROS1
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    wrench = types["geometry_msgs/msg/WrenchStamped"](
        header(store, stamp * 1_000_000_007 % 2**60, frame),
        types["geometry_msgs/msg/Wrench"](vector(*numbers[:3]), vector(*numbers[3:6])),
    )
    joints = types["sensor_msgs/msg/JointState"](
        header(store, stamp, frame),
        [frame, "ß", ""],
        np.array(numbers[:3]),
        np.zeros(0),
        np.array(numbers[3:6]),
    )
    pairs: list[tuple[str, Any]] = [("WrenchStamped", wrench), ("JointState", joints)]
    for name, message in pairs:
        full = f"{'geometry_msgs' if name[0] == 'W' else 'sensor_msgs'}/msg/{name}"
        kind = kind_of(full)
        assert kind is not None
        if ros2:
            raw = bytes(store.serialize_cdr(message, full, little_endian=not big))
        else:
            raw = bytes(store.serialize_ros1(message, full))
        found = decode(kind, [raw, raw], cdr=ros2, topic="/t")
        at = message.header.stamp
        assert found.stamp[1] == at.sec * 10**9 + at.nanosec
        if kind.role == "joints":
            assert found.names == (frame, "ß", "")
            np.testing.assert_array_equal(found.values[1], [*numbers[:3], np.nan, np.nan, np.nan])
        else:
            np.testing.assert_array_equal(found.values[1], numbers[:6])


@given(
    raw=st.binary(max_size=120),
    cdr=st.booleans(),
    kind=st.sampled_from(["Wrench", "WrenchStamped", "PoseStamped"]),
)
def test_garbage_is_no_message(raw, cdr, kind):
    wanted = kind_of(f"geometry_msgs/msg/{kind}")
    joints = kind_of("sensor_msgs/msg/JointState")
    assert wanted is not None
    assert joints is not None
    for each in (wanted, joints):
        try:
            found = decode(each, [raw], cdr=cdr, topic="/t")
        except FileError as error:
            assert "message 0 of /t is damaged" in str(error)  # noqa: PT017
        else:
            assert len(found.values) == 1


# --- damage --------------------------------------------------------------------------------------------------


def outcome(path: Path, *, repair: bool = False) -> str:
    try:
        return " ".join(map(str, read(path, repair=repair).findings))
    except (FileError, InputError) as error:
        return str(error)


@pytest.mark.parametrize("kind", ["ros1", "ros1-bz2", "ros1-lz4", "mcap", "mcap-lz4", "mcap-zstd"])
@pytest.mark.parametrize("share", [0.0005, 0.02, 0.5, 0.98])
def test_truncated_bags_give_one_clear_line(tmp_path: Path, kind: str, share: float):
    path = WRITERS[kind](tmp_path / "log")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises((FileError, InputError)) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_an_unfinished_mcap_is_read_up_to_its_end_when_asked(tmp_path: Path):
    path = WRITERS["mcap-zstd"](tmp_path / "log")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(FileError, match="damaged or cut off"):
        read(path)
    recording = read(path, repair=True)
    np.testing.assert_array_equal(recording.wrench, GOOD.wrench[: len(recording)])
    assert len(recording) > 50
    assert any("breaks off after" in note for note in recording.notes)


def test_time_that_runs_backwards_is_refused_and_dropped_when_asked(tmp_path: Path):
    found = messages(ROS2)
    poses = [i for i, message in enumerate(found) if message[0] == "/ee_pose"]
    topic, kind, time, message = found[poses[100]]
    back = ROS2.types[kind](header(ROS2, START, "base_link"), message.pose)
    found[poses[100]] = (topic, kind, time, back)
    path = write_mcap(tmp_path / "log", found, CompressionType.NONE)
    with pytest.raises(FileError, match="the time of /ee_pose runs backwards 1 times, first at message 100"):
        read(path)
    assert len(read(path, repair=True)) == len(GOOD)
    assert len(read(path, stamps="arrival")) == len(GOOD)


def test_clocks_that_never_meet_are_told(tmp_path: Path):
    found = [
        m if m[0] != "/ee_pose" else (m[0], m[1], m[2] + 10**12, m[3]) for m in messages(ROS2, stamped=False)
    ]
    with pytest.raises(FileError, match="have no time in common"):
        read(write_mcap(tmp_path / "log", found, CompressionType.NONE))


def test_a_chunk_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    paths = [WRITERS[kind](tmp_path / kind) for kind in ("ros1-bz2", "ros1-lz4", "mcap-lz4", "mcap-zstd")]
    monkeypatch.setattr("vic_toolbox.recordings.containers.LARGEST_CHUNK", 1000)
    for path in paths:
        with pytest.raises(FileError, match="unpacks to more than"):
            read(path)


HOSTILE = "float64 x\n__import__('pathlib').Path('exploited').touch()\n"


def test_definitions_in_a_bag_are_not_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Definitions that are Python rather than messages do nothing: only the name of a type is looked at."""
    monkeypatch.chdir(tmp_path)
    with Writer1(tmp_path / "log.bag") as bag:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in messages(ROS1):
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, msgdef=HOSTILE, md5sum="0" * 32)
            bag.write(connections[topic], time, ROS1.serialize_ros1(message, kind))
    np.testing.assert_array_equal(read("log.bag").wrench, GOOD.wrench)
    assert not Path("exploited").exists()


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_compressed_bags_of_ros2_are_read(tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode):
    """Files and messages compressed with Zstandard, in a folder or the one file of it alone."""
    if plugin is StoragePlugin.MCAP and mode is CompressionMode.MESSAGE:
        mode = CompressionMode.STORAGE  # chunks
    folder = write_ros2(tmp_path / "a", messages(ROS2), plugin, mode)
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    for path in (folder, file):
        np.testing.assert_array_equal(read(path).wrench, GOOD.wrench)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_parts_of_a_folder_go_by_their_numbers(tmp_path: Path, plugin: StoragePlugin):
    """The second file of a bag comes before the tenth, and the metadata need not be there."""
    whole, found = tmp_path / "whole", messages(ROS2)
    whole.mkdir()
    for number in range(11):
        part = found[number * len(found) // 11 : (number + 1) * len(found) // 11]
        folder = write_ros2(tmp_path / str(number), part, plugin)
        (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
        file.rename(whole / f"bag_{number}{file.suffix}")
    np.testing.assert_array_equal(read(whole, stamps="arrival").wrench, GOOD.wrench)


def test_metadata_is_not_believed(tmp_path: Path):
    folder = write_ros2(tmp_path / "a", messages(ROS2), StoragePlugin.SQLITE3)
    for text in ("", "a: [", "!!python/object/apply:os.system ['touch exploited']", "\0"):
        (folder / "metadata.yaml").write_text(text)
        np.testing.assert_array_equal(read(folder).wrench, GOOD.wrench)
    assert not list(tmp_path.rglob("exploited"))


@pytest.mark.parametrize("name", ["50 %41 #1?.db3", "a b.sqlite"])
def test_any_name_of_a_database_will_do(tmp_path: Path, name: str):
    folder = write_ros2(tmp_path / "a", messages(ROS2), StoragePlugin.SQLITE3)
    np.testing.assert_array_equal(read((folder / "a.db3").rename(tmp_path / name)).wrench, GOOD.wrench)


ENDLESS = """
alter table messages rename to kept;
create view messages as with recursive n(id) as (select 1 union all select id + 1 from n)
    select id, 1 as topic_id, id as timestamp, zeroblob(100) as data from n;
"""
COMPUTED = """
drop table messages;
create table messages(id integer primary key, topic_id, timestamp,
    data blob generated always as (zeroblob(900000000)) virtual);
insert into messages(topic_id, timestamp) select id, id from topics;
"""


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("drop table topics", "no table topics"),
        (ENDLESS, "no table messages"),
        (COMPUTED, "too big"),
        ("update messages set data = 'text'", "holds no bytes"),
        ("update messages set timestamp = 'now'", "or no time"),
        ("update messages set data = x'28b52ffd'", "is damaged"),
        ("update topics set name = 'a' || char(10)", "a\\\\n"),
    ],
)
def test_hostile_databases(tmp_path: Path, script: str, message: str):
    folder = write_ros2(tmp_path / "a", messages(ROS2), StoragePlugin.SQLITE3)
    with contextlib.closing(sqlite3.connect(folder / "a.db3")) as database:
        database.executescript(script)
    with pytest.raises((FileError, InputError), match=message) as caught:
        read(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)


def test_zstandard_that_unpacks_to_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A small file, or message, that is gigabytes when unpacked."""
    bomb = zstandard.compress(bytes(1 << 22))
    monkeypatch.setattr("vic_toolbox.recordings.containers.LARGEST_BYTES", 1 << 20)
    monkeypatch.setattr("vic_toolbox.recordings.containers.LARGEST_CHUNK", 1 << 20)
    (tmp_path / "a.db3.zstd").write_bytes(bomb)
    with pytest.raises(FileError, match="too much for one recording"):
        read(tmp_path / "a.db3.zstd")
    folder = write_ros2(tmp_path / "a", messages(ROS2), StoragePlugin.SQLITE3)
    with contextlib.closing(sqlite3.connect(folder / "a.db3")) as database:
        database.execute("update messages set data = ?", [bomb])
        database.commit()
    with pytest.raises(FileError, match="unpacks to more than"):
        read(folder)


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("bags")
    kinds = ("ros1", "ros1-lz4", "mcap", "mcap-zstd")
    found = {kind: WRITERS[kind](folder / kind) for kind in kinds}
    (found["db3"],) = WRITERS["ros2-sqlite"](folder / "db3").glob("*.db3")
    return {f"{kind}{path.suffix}": path.read_bytes() for kind, path in found.items()}


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_never_gives_more_than_one_clear_line(
    contents: dict[str, bytes], tmp_path: Path, data: st.DataObject
):
    name, content = data.draw(st.sampled_from(sorted(contents.items())))
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        near = data.draw(st.sampled_from([200, 5000, len(damaged)]))  # the beginning holds the lengths
        damaged[data.draw(st.integers(0, near - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / name
    path.write_bytes(damaged[: data.draw(st.one_of(st.just(len(damaged)), st.integers(0, len(damaged))))])
    assert "\n" not in outcome(path, repair=data.draw(st.booleans()))


def test_struct_sizes_that_lie():
    """A name of a frame that claims four gigabytes."""
    kind = kind_of("geometry_msgs/WrenchStamped")
    assert kind is not None
    raw = struct.pack("<IIII", 0, 1, 2, 2**32 - 1) + b"\0" * 60
    with pytest.raises(FileError, match="longer than the message"):
        decode(kind, [raw], cdr=False, topic="/t")


def test_orientations_are_interpolated_on_the_sphere(tmp_path: Path):
    recording = read(WRITERS["ros1"](tmp_path / "log", pose_every=50))
    norm = np.linalg.norm(recording.quat_wxyz, axis=1)
    np.testing.assert_allclose(norm, 1, atol=1e-12)
    assert len(quaternions.sign_flips(recording.quat_wxyz)) == 0
