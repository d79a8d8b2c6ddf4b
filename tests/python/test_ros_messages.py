"""Messages of ROS 2 without ROS: imports, classes, definitions of users, the codec, bytes."""

from __future__ import annotations

import array
import copy
import importlib
import pickle
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import ROOT, Bench, finish
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from hprm._hprm import decode, encode
from hprm._views import Fields, views
from hprm.ros import _messages
from hprm.ros._messages import DefinitionError, class_of, packages
from hprm.ros._messages.cdr import SERIALIZER
from hprm.ros._messages.packages import KINDS
from hprm.ros.serialization import SerializationError, deserialize_message, serialize_message

_messages.install()

JAZZY = get_typestore(Stores.ROS2_JAZZY)
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)

EVERY = [
    f"{package}/{kind}/{name}"
    for package in packages.standard_names()
    for kind in KINDS
    for name in packages.standard(package).names(kind)  # type: ignore[union-attr]
]
MESSAGES = [it for it in EVERY if "/msg/" in it]

# What Humble has otherwise: a constant's type, the length of an identifier, fields that came later.
CHANGED_SINCE_HUMBLE = {
    "rcl_interfaces/msg/Log",
    "rmw_dds_common/msg/Gid",
    "rosbag2_interfaces/msg/ReadSplitEvent",
    "rosbag2_interfaces/msg/WriteSplitEvent",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/NavSatStatus",
    "sensor_msgs/msg/Range",
    "visualization_msgs/msg/Marker",
}


def known(store: Any, name: str) -> tuple[Any, Any]:
    """What a type store has of a type: constants as numbers, and fields."""
    constants, fields = store.fielddefs[name]
    plain = [(it, kind, v[0] if isinstance(v, bytes) else v) for it, kind, v in constants]
    return plain, fields


def test_every_message_of_jazzy_is_there_with_its_fields_and_constants() -> None:
    for name in JAZZY.fielddefs:
        SERIALIZER.register(class_of(name))
        assert known(SERIALIZER.store, name) == known(JAZZY, name), name
        assert SERIALIZER.store.hash_rihs01(name) == JAZZY.hash_rihs01(name)


def test_every_message_of_humble_is_there_and_the_others_are_those_that_have_changed() -> None:
    changed = set()
    for name in HUMBLE.fielddefs:
        SERIALIZER.register(class_of(name))
        if known(SERIALIZER.store, name) != known(HUMBLE, name):
            changed.add(name)
    assert changed == CHANGED_SINCE_HUMBLE


@pytest.mark.parametrize("name", EVERY)
def test_every_standard_interface_can_be_made_shown_compared_and_copied(name: str) -> None:
    kind = class_of(name)
    parts = {
        "msg": lambda: [kind],
        "srv": lambda: [kind.Request, kind.Response],
        "action": lambda: [
            *(kind.Goal, kind.Result, kind.Feedback, kind.Impl.FeedbackMessage),
            *(kind.Impl.SendGoalService.Request, kind.Impl.SendGoalService.Response),
            *(kind.Impl.GetResultService.Request, kind.Impl.GetResultService.Response),
        ],
    }[name.split("/")[1]]()
    for part in parts:
        made = part()
        assert made == part() == copy.deepcopy(made) == made._copied()
        assert repr(made).startswith(f"{name.split('/')[0]}.{name.split('/')[1]}.")
        assert part.get_fields_and_field_types().keys() == {it[1:] for it in part.__slots__}
        values = {it: getattr(made, it) for it in part.get_fields_and_field_types()}
        assert part(**values) == made
        for field, value in values.items():
            setattr(made, field, value)
        assert decode(*encode(made, local=False), local=False) == made


def test_imports_have_the_names_of_ros() -> None:
    from geometry_msgs.msg._twist import Twist
    from std_msgs.msg import String
    from tf2_msgs.action import LookupTransform

    twist = importlib.import_module("geometry_msgs.msg").Twist
    assert Twist is twist
    assert (String.__module__, String.__qualname__) == ("std_msgs.msg._string", "String")
    assert _messages.type_name(LookupTransform) == "tf2_msgs/action/LookupTransform"
    assert class_of("std_msgs/String") is class_of("std_msgs/msg/String") is String
    everything: dict[str, Any] = {}
    exec("from std_msgs.msg import *", everything)
    assert everything["UInt8MultiArray"] is class_of("std_msgs/msg/UInt8MultiArray")
    assert "Header" in dir(importlib.import_module("std_msgs.msg"))
    with pytest.raises(ImportError, match="cannot import name 'Strin'"):
        exec("from std_msgs.msg import Strin")
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("std_msgs.srv")
    for wrong in ("std_msgs", "std_msgs/msg/Strin", "no_msgs/msg/A"):
        with pytest.raises(LookupError):
            class_of(wrong)


def test_an_installation_goes_first_and_a_mere_folder_does_not(tmp_path: Path) -> None:
    (tmp_path / "std_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "turtlesim" / "msg").mkdir(parents=True)
    for folder in ("turtlesim", "turtlesim/msg"):
        (tmp_path / folder / "__init__.py").write_text("Pose = 'installed'")
    program = (
        "from hprm.ros import _messages; _messages.install({})\n"
        "from std_msgs.msg import String\n"
        "from turtlesim.msg import Pose\n"
        "print(String.__name__, Pose)"
    )
    shown = {}
    for first in (False, True):
        (tmp_path / "program.py").write_text(program.format(first))
        argv = [sys.executable, "program.py"]
        done = subprocess.run(argv, cwd=tmp_path, capture_output=True, text=True, check=True)
        shown[first] = done.stdout
    assert shown[False] == "String installed\n"
    assert shown[True] == "String <class 'turtlesim.msg._pose.Pose'>\n"


def test_what_is_shown_is_what_ros_shows() -> None:
    from geometry_msgs.msg import Point
    from sensor_msgs.msg import Image, Imu
    from std_msgs.msg import String

    assert repr(String(data="x")) == "std_msgs.msg.String(data='x')"
    assert repr(Point(x=1.0)) == "geometry_msgs.msg.Point(x=1.0, y=0.0, z=0.0)"
    assert "encoding='', is_bigendian=0, step=0, data=[1, 2])" in repr(Image(data=[1, 2]))
    assert "angular_velocity_covariance=array([0., 0., 0., 0., 0." in repr(Imu())
    request = class_of("example_interfaces/srv/AddTwoInts").Request(a=2)
    assert repr(request) == "example_interfaces.srv.AddTwoInts_Request(a=2, b=0)"
    assert str(class_of("std_msgs/msg/Int32MultiArray")().data) == "array('i')"


def test_fields_have_the_defaults_of_their_definitions() -> None:
    from diagnostic_msgs.msg import DiagnosticStatus
    from geometry_msgs.msg import Quaternion
    from rcl_interfaces.msg import ParameterValue
    from sensor_msgs.msg import Imu, NavSatStatus
    from visualization_msgs.msg import Marker

    assert Quaternion() == Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    assert (Quaternion.W__DEFAULT, NavSatStatus().status) == (1.0, -2)
    assert isinstance(Imu().orientation_covariance, np.ndarray)
    assert Imu().orientation_covariance.tolist() == [0.0] * 9
    assert (Marker.ADD, Marker().ADD, Marker.DELETEALL) == (0, 0, 3)
    assert (DiagnosticStatus().level, DiagnosticStatus.ERROR) == (b"\0", b"\2")
    assert (ParameterValue().bool_array_value, ParameterValue().byte_array_value) == ([], [])


def test_fields_tell_their_types_as_ros_does() -> None:
    told = {
        "sensor_msgs/msg/Image": {"header": "std_msgs/Header", "data": "sequence<uint8>"},
        "sensor_msgs/msg/Imu": {"orientation_covariance": "double[9]"},
        "rcl_interfaces/msg/ParameterDescriptor": {
            "integer_range": "sequence<rcl_interfaces/IntegerRange, 1>",
            "read_only": "boolean",
        },
        "shape_msgs/msg/SolidPrimitive": {"dimensions": "sequence<double, 3>"},
        "diagnostic_msgs/msg/DiagnosticStatus": {"level": "octet"},
        "geometry_msgs/msg/Point32": {"x": "float"},
        "type_description_interfaces/msg/FieldType": {"nested_type_name": "string<255>"},
    }
    for name, fields in told.items():
        assert class_of(name).get_fields_and_field_types().items() >= fields.items()
    with pytest.raises(AttributeError, match="rosidl_parser"):
        _ = class_of("std_msgs/msg/String").SLOT_TYPES


REFUSED: list[tuple[str, str, Any, str]] = [
    ("std_msgs/msg/String", "data", 3, "The 'data' field must be of type 'str'"),
    ("std_msgs/msg/Float64", "data", 3, "The 'data' field must be of type 'float'"),
    ("std_msgs/msg/Float32", "data", 1e39, "The 'data' field must be a float in"),
    ("std_msgs/msg/Int8", "data", 128, "must be an integer in [-128, 127]"),
    ("std_msgs/msg/UInt8", "data", -1, "must be an unsigned integer in [0, 255]"),
    ("std_msgs/msg/Int64", "data", 1.0, "must be of type 'int'"),
    ("std_msgs/msg/Bool", "data", 1, "must be of type 'bool'"),
    ("std_msgs/msg/Byte", "data", 1, "of type 'bytes' or 'ByteString' with length 1"),
    ("geometry_msgs/msg/Pose", "position", None, "a sub message of type 'Point'"),
    ("std_msgs/msg/Int16MultiArray", "data", [1, 40000], "each integer in [-32768, 32767]"),
    ("std_msgs/msg/Int16MultiArray", "data", [1.0], "each value of type 'int'"),
    ("std_msgs/msg/Int16MultiArray", "data", "12", "a set or sequence"),
    ("std_msgs/msg/Int16MultiArray", "data", array.array("i"), "the type code of 'h'"),
    ("std_msgs/msg/Int16MultiArray", "data", np.zeros(2), "the dtype of 'numpy.int16'"),
    ("std_msgs/msg/Int16MultiArray", "data", np.zeros((2, 2), "i2"), "must have one dimension"),
    ("std_msgs/msg/Float32MultiArray", "data", [1.0, 1e39], "each float in"),
    ("sensor_msgs/msg/Imu", "orientation_covariance", [0.0] * 8, "with length 9"),
    ("sensor_msgs/msg/Imu", "orientation_covariance", np.zeros(8), "must have a size of 9"),
    ("sensor_msgs/msg/Imu", "orientation_covariance", np.zeros(9, "f4"), "'numpy.float64'"),
    ("shape_msgs/msg/SolidPrimitive", "dimensions", [0.0] * 4, "with length <= 3"),
    ("sensor_msgs/msg/JointState", "name", ["a", 1], "each value of type 'str'"),
    ("geometry_msgs/msg/Polygon", "points", [1], "each value of type 'Point32'"),
    ("type_description_interfaces/msg/FieldType", "nested_type_name", "x" * 256, "not longer"),
]


@pytest.mark.parametrize(("name", "field", "value", "words"), REFUSED)
def test_values_of_other_types_are_refused(name: str, field: str, value: Any, words: str) -> None:
    made = class_of(name)()
    with pytest.raises(AssertionError) as refused:
        setattr(made, field, value)
    assert words in str(refused.value)
    assert made == class_of(name)()


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("sensor_msgs/msg/LaserScan", "ranges", None),
        ("sensor_msgs/msg/LaserScan", "ranges", ["x"]),
        ("sensor_msgs/msg/Image", "data", "abc"),
        ("sensor_msgs/msg/Image", "data", [256]),
        ("sensor_msgs/msg/Image", "data", np.array([256])),
        ("sensor_msgs/msg/Imu", "orientation_covariance", ["x"] * 9),
    ],
)
def test_a_constructor_names_the_field_of_a_wrong_value(name: str, field: str, value: Any) -> None:
    with pytest.raises(AssertionError, match=f"The '{field}' field must be a set or sequence"):
        class_of(name)(**{field: value})


def test_a_constructor_refuses_what_is_no_field_and_converts_numbers() -> None:
    from sensor_msgs.msg import Imu
    from std_msgs.msg import Float64MultiArray, String

    with pytest.raises(AssertionError, match="Invalid arguments passed to constructor: text"):
        String(text="x")
    assert Float64MultiArray(data=[1, 2]).data == array.array("d", [1.0, 2.0])
    assert Float64MultiArray(data=np.ones(2, "i4")).data == array.array("d", [1.0, 1.0])
    assert Imu(orientation_covariance=range(9)).orientation_covariance[8] == 8.0


def test_sequences_of_numbers_are_arrays_that_grow_or_the_array_that_was_assigned() -> None:
    fibonacci = class_of("action_tutorials_interfaces/action/Fibonacci").Feedback()
    fibonacci.partial_sequence = [0, 1]
    fibonacci.partial_sequence.append(1)
    assert fibonacci.partial_sequence == array.array("i", [0, 1, 1])
    image = class_of("sensor_msgs/msg/Image")()
    for same in (b"ab", bytearray(b"ab"), memoryview(b"ab"), [97, 98], (97, 98)):
        image.data = same
        assert image.data == array.array("B", b"ab")
    pixels = np.zeros(10_000_000, "u1")
    image.data = pixels
    assert image.data is pixels
    assert type(image)(data=pixels).data is pixels
    assert image._copied().data is pixels
    image.data = np.frombuffer(b"ab", "u1")
    assert image == type(image)(data=b"ab") != type(image)(data=b"ac")
    assert image._copied().data is not image.data


def test_the_program_of_the_page_assigns_an_array_without_a_copy() -> None:
    page = (ROOT / "docs" / "reference" / "ros-messages.md").read_text()
    names: dict[str, Any] = {}
    exec(page.partition("```python\n")[2].partition("```")[0], names)
    assert names["message"].data.nbytes == 480 * 640 * 3
    assert isinstance(names["message"].data, np.ndarray)


def test_numbers_of_derived_types_become_numbers() -> None:
    from std_msgs.msg import Float64, Int32

    assert type(Float64(data=np.float64(2.0)).data) is float
    assert type(Int32(data=True).data) is int


def test_messages_are_not_hashed_and_services_not_made() -> None:
    with pytest.raises(TypeError):
        hash(class_of("std_msgs/msg/String")())
    for name in ("std_srvs/srv/Trigger", "tf2_msgs/action/LookupTransform"):
        with pytest.raises(NotImplementedError):
            class_of(name)()
    message = class_of("geometry_msgs/msg/PoseStamped")()
    assert pickle.loads(pickle.dumps(message)) == message


# Definitions of users.


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes definitions of a package, which are found until the test ends."""
    monkeypatch.setenv("HPRM_ROS_PACKAGES", str(tmp_path))
    name = f"package_{tmp_path.parent.name.replace('-', '_')}_{random.getrandbits(32)}"

    def write(**files: str) -> str:
        for file, text in files.items():
            stem, _, kind = file.rpartition("_")
            (tmp_path / name / kind).mkdir(parents=True, exist_ok=True)
            (tmp_path / name / kind / f"{stem}.{kind}").write_text(text)
        importlib.invalidate_caches()
        return name

    yield write
    monkeypatch.undo()
    importlib.invalidate_caches()


def test_definitions_of_users_are_compiled_at_import(user: Any) -> None:
    package = user(
        Wheel_msg=(
            "# a wheel\nuint8 LEFT=1\nstring NAME = 'a, b'\nstring SIDE=left side # no more\n"
            'float64 speed 1.5\nint32[] samples [-1, 0x10]\nstring<=3 tag "ab"\n'
        ),
        Car_msg="Wheel[4] wheels\nWheel[<=2] spare\nstd_msgs/Header header\n"
        "bool[2] lights [1, 0]\n",
        Drive_srv="Car car\n---\nbool done\n",
        Turn_action="float32 angle\n---\nfloat32 turned\n---\nfloat32 left\n",
    )
    car = class_of(f"{package}/msg/Car")()
    assert [it.speed for it in car.wheels] == [1.5] * 4
    assert (car.wheels[0].samples.tolist(), car.wheels[0].tag) == ([-1, 16], "ab")
    assert (car.spare, car.lights, car.header.frame_id) == ([], [True, False], "")
    wheel = type(car.wheels[0])
    assert (wheel.LEFT, wheel.NAME, wheel.SIDE) == (1, "a, b", "left side")
    assert class_of(f"{package}/srv/Drive").Request(car=car).car is car
    goal = class_of(f"{package}/action/Turn").Impl.SendGoalService.Request()
    assert goal.goal == class_of(f"{package}/action/Turn").Goal(angle=0.0)
    assert deserialize_message(serialize_message(car), type(car)) == car


WRONG = [
    ("float64 x\nfloat65 y\n", ":2: the type 'float65' is unknown; basic types are bool"),
    ("float64\n", ":1: 'float64' is neither a field"),
    ("no_msgs/Pose pose\n", ":1: the type of 'pose' is unknown: there is no package 'no_msgs'"),
    ("\nstd_msgs/Strin text\n", ":2: the type of 'text' is unknown: the package 'std_msgs'"),
    ("int32 X\n", ":1: 'X': fields have names like wheel_speed"),
    ("int32 x=3\n", ":1: 'x': constants have names like MAX_SPEED"),
    ("uint8 X=256\n", ":1: '256' is no value of the type uint8"),
    ("int32[2] x [1]\n", ":1: [1]: 1 values are not int32[2]"),
    ("int32 x\nint32 x\n", ":2: "),
    ("std_msgs/Header h 3\n", ":1: a message has no default value"),
    ("int32<=3 x\n", ":1: only texts have a bound"),
    ("int32 x\n---\nint32 y\n", "has 2 parts between lines of '---', and needs 1"),
    ("Broken broken\n", ":1: the type of 'broken' is unknown: "),
]


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_a_wrong_definition_names_its_file_and_line(user: Any, text: str, words: str) -> None:
    package = user(Broken_msg=text)
    with pytest.raises(DefinitionError) as wrong:
        class_of(f"{package}/msg/Broken")
    assert f"{package}/msg/Broken.msg:" in str(wrong.value)
    assert words in str(wrong.value)


def test_packages_are_beside_the_program_in_src_above_it_and_where_package_xml_names_them(
    tmp_path: Path,
) -> None:
    for folder in ("src/node", "src/node/near_msgs/msg", "src/far_msgs/msg", "src/repo/other/msg"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("src/node/near_msgs", "src/far_msgs", "src/repo/other"):
        (tmp_path / folder / "msg" / "Num.msg").write_text("int64 num\n")
    xml = "<package><name>named_msgs</name></package>"
    (tmp_path / "src/repo/other/package.xml").write_text(xml)
    (tmp_path / "src/node/node.py").write_text(
        "from hprm.ros import _messages; _messages.install()\n"
        "from near_msgs.msg import Num as a\nfrom far_msgs.msg import Num as b\n"
        "from named_msgs.msg import Num as c\nprint(a(), b(), c())"
    )
    argv = [sys.executable, str(tmp_path / "src/node/node.py")]
    done = subprocess.run(argv, capture_output=True, text=True, check=True)
    expected = (f"{it}_msgs.msg.Num(num=0)" for it in ("near", "far", "named"))
    assert done.stdout.split() == list(expected)


# Between federates.

PROGRAM = """
import numpy as np
import hprm
from hprm.ros import _messages

_messages.install()
from sensor_msgs.msg import Image, Imu


class Camera(hprm.Reactor):
    image = hprm.Output(Image)
    imu = hprm.Output(Imu)

    @hprm.reaction(hprm.startup, effects=[image, imu])
    def capture(self) -> None:
        message = Image(data=np.full(10_000_000, 7, np.uint8), height=1000)
        message.header.stamp.sec = 5
        self.image.set(message)
        self.imu.set(Imu(orientation_covariance=np.arange(9.0)))


class Viewer(hprm.Reactor):
    image = hprm.Input(Image)
    imu = hprm.Input(Imu)

    @hprm.reaction(image, imu)
    def show(self) -> None:
        message = self.image.value
        print(type(message) is Image, message.height, message.header)
        print(type(message.data) is np.ndarray, message.data.flags.writeable, message.data.sum())
        address = message.data.ctypes.data
        for line in open("/proc/self/maps"):
            start, end = (int(it, 16) for it in line.split()[0].split("-"))
            if start <= address < end:
                print("memfd" in line)
        print(self.imu.value.orientation_covariance.tolist() == list(range(9)))


class Vision(hprm.Federation, timeout="100 ms"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.viewer = Viewer()
        hprm.connect(self.camera.image, self.viewer.image)
        hprm.connect(self.camera.imu, self.viewer.imu)
"""


def test_messages_pass_between_federates_without_pickle_and_large_arrays_through_the_store(
    bench: Bench,
) -> None:
    (bench.folder / "app.py").write_text(PROGRAM)
    outcome = finish(bench.call("run", "app.py", environment={"HPRM_PICKLE": "deny"}))
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == [
        "[viewer] True 1000 std_msgs.msg.Header("
        "stamp=builtin_interfaces.msg.Time(sec=5, nanosec=0), frame_id='')",
        "[viewer] True False 70000000",
        "[viewer] True",
        "[viewer] True",
    ]


def test_a_message_with_other_fields_is_refused_by_the_codec() -> None:
    from std_msgs.msg import String

    head, parts = encode(String(data="x"), local=False)
    assert b"\x06\x08data" in bytes(head)
    other = bytes(head).replace(b"\x06\x08data", b"\x06\x08dota")
    with pytest.raises(ValueError, match="String has other fields here"):
        decode(other, parts, local=False)


def test_viewers_show_the_fields_of_messages() -> None:
    shown = dict(views(class_of("geometry_msgs/msg/PointStamped")()))
    fields = shown[""]
    assert isinstance(fields, Fields)
    assert fields.fields["point"] == {"x": 0.0, "y": 0.0, "z": 0.0}


# As bytes.


def filled(kind: type, chance: random.Random, depth: int = 0) -> Any:
    """A message with values by chance."""
    made = kind()
    for it in kind.__hprm_structure__.fields:  # type: ignore[attr-defined]
        many = it.type.many
        length = it.type.size if many == "array" else chance.randrange((it.type.size or 3) + 1)
        values = [value(it, kind, chance, depth) for _ in range(1 if many is None else length)]
        setattr(made, it.name, values[0] if many is None else values)
    return made


def value(it: Any, kind: Any, chance: random.Random, depth: int) -> Any:
    base = it.type.base
    if it.type.is_message:
        return filled(kind.__hprm_kinds__[it.name], chance, depth + 1)
    if base == "bool":
        return chance.random() < 0.5
    if base == "byte":
        return chance.randbytes(1)
    if base == "string":
        return "".join(chance.choice("abcäß€") for _ in range(chance.randrange(9)))
    if base.startswith("float"):
        return float(np.float32(chance.uniform(-1e3, 1e3)))
    low, high = _messages.definitions.limits(base)
    return chance.choice([low, high, chance.randint(low, high)])


def theirs(message: Any, store: Any) -> Any:
    """The same message as an object of ``rosbags``, made by other means than ours."""
    structure = message.__hprm_structure__
    members = []
    for it in structure.fields:
        held = getattr(message, it.name)
        if it.type.is_message:
            one = it.type.many is None
            held = theirs(held, store) if one else [theirs(each, store) for each in held]
        elif it.type.base == "byte":
            numbers = np.array([each[0] for each in ([held] if it.type.many is None else held)])
            numbers = numbers.astype("u1").view("i1")
            held = int(numbers[0]) if it.type.many is None else numbers
        elif it.type.many is not None and it.type.base != "string":
            held = np.array(list(held), {"char": "u1", "bool": "?"}.get(it.type.base, it.type.base))
        members.append(held)
    return store.types[structure.name](*members)


@pytest.mark.parametrize("name", sorted(JAZZY.fielddefs))
def test_bytes_are_those_that_rosbags_writes(name: str) -> None:
    kind = class_of(name)
    chance = random.Random(name)
    for _ in range(5):
        message = filled(kind, chance)
        data = serialize_message(message)
        assert data == bytes(JAZZY.serialize_cdr(theirs(message, JAZZY), name, little_endian=True))
        read = deserialize_message(data, kind)
        assert read == message
        for field in kind._fields_and_field_types:
            setattr(read, field, getattr(read, field))
        big = JAZZY.serialize_cdr(theirs(message, JAZZY), name, little_endian=False)
        assert deserialize_message(bytes(big), kind) == message


def test_bytes_that_are_no_such_message_are_one_error() -> None:
    from sensor_msgs.msg import Image
    from std_msgs.msg import String

    data = serialize_message(Image(data=b"abc"))
    for wrong in (b"", b"\0\1", data[:-2], b"\7" * 40, data + b"12345678"):
        with pytest.raises(SerializationError, match=r"no message of sensor_msgs/msg/Image"):
            deserialize_message(wrong, Image)
    with pytest.raises(SerializationError, match="no bytes"):
        serialize_message(String(data="\ud800"))
    with pytest.raises(SerializationError, match="wide text"):
        serialize_message(class_of("example_interfaces/msg/WString")())
    with pytest.raises(TypeError, match="is no class of messages"):
        serialize_message("text")
    assert issubclass(SerializationError, ValueError) and not issubclass(SerdeError, ValueError)


def test_without_rosbags_messages_work_and_bytes_are_one_error(tmp_path: Path) -> None:
    program = (
        "import sys\nsys.modules['rosbags'] = None\n"
        "from hprm.ros import _messages; _messages.install()\n"
        "from std_msgs.msg import String\nprint(String(data='x'))\n"
        "try:\n    import hprm.ros.serialization\nexcept ImportError as error:\n    print(error)\n"
    )
    argv = [sys.executable, "-c", program]
    done = subprocess.run(argv, cwd=tmp_path, capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    assert first == "std_msgs.msg.String(data='x')"
    assert second.startswith(f"the package rosbags is not installed for {sys.executable}")
    assert second.endswith(f"{sys.executable} -m pip install 'hprm[ros]'")


def test_packages_are_found_for_a_program_that_another_one_runs(tmp_path: Path) -> None:
    (tmp_path / "near_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "near_msgs" / "msg" / "Num.msg").write_text("int64 num\n")
    (tmp_path / "node.py").write_text("from near_msgs.msg import Num\nprint(Num())\n")
    program = (
        "from hprm.ros import _messages; _messages.install()\nimport runpy, std_msgs.msg\n"
        f"runpy.run_path({str(tmp_path / 'node.py')!r}, run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "near_msgs.msg.Num(num=0)\n"
