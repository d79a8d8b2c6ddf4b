"""Protocol Buffers: modules for the ``protobufs`` of a program, and the serializer ``proto``.

The compiler comes from the package ``grpcio-tools``, or is ``protoc`` on the ``PATH``. For programs
that do not use them nothing is imported, neither that nor the runtime ``protobuf``.
"""

import importlib
import importlib.util
import os
import sys
from types import ModuleType
from typing import Any

_PACKAGE = "pip install grpcio-tools"


def messages(stated: list[tuple[str, str]]) -> dict[str, ModuleType]:
    """Compile ``.proto`` files and import what comes of them: ``X_pb2``, by the name ``X``.

    Each path comes with the program that states it, and is relative to that.
    """
    if not stated:
        return {}
    import tempfile

    _require_runtime("`protobufs`")
    paths = [_found(name, stated_in) for name, stated_in in dict.fromkeys(stated)]
    stems = [os.path.splitext(os.path.basename(path))[0] for path in paths]
    # What is imported is known from then on, so nothing is left to be cleaned up.
    with tempfile.TemporaryDirectory(prefix="hprm-protobuf-") as generated:
        _compile(paths, generated)
        sys.path.insert(0, generated)
        try:
            return {stem: importlib.import_module(f"{stem}_pb2") for stem in stems}
        finally:
            sys.path.remove(generated)


class Serializer:
    """What ``serializer "proto"`` means: messages, each behind the name of its type."""

    def __init__(self) -> None:
        """Find the runtime."""
        _require_runtime('serializer "proto"')

    def serialize(self, message: Any) -> bytes:
        """Return the name of the type, a zero, and the message."""
        descriptor = getattr(message, "DESCRIPTOR", None)
        if descriptor is None:
            kind = type(message).__name__
            raise TypeError(
                f'serializer "proto" takes messages of Protocol Buffers, and this is a {kind}'
            )
        return bytes(descriptor.full_name.encode() + b"\0" + message.SerializeToString())

    def deserialize(self, data: bytes) -> Any:
        """Rebuild the message."""
        from google.protobuf import descriptor_pool, message_factory

        name, _, content = bytes(data).partition(b"\0")
        try:
            descriptor = descriptor_pool.Default().FindMessageTypeByName(name.decode())
        except KeyError:
            raise RuntimeError(
                f"a message of type {name.decode()} arrived, of which nothing is known here; "
                "name its file in the target property `protobufs`"
            ) from None
        return message_factory.GetMessageClass(descriptor).FromString(content)


def _found(name: str, stated_in: str) -> str:
    path = os.path.join(os.path.dirname(os.path.abspath(stated_in)), name)
    if not os.path.isfile(path):
        raise FileNotFoundError(f"there is no {path}, which `protobufs` in {stated_in} names")
    return path


def _compile(paths: list[str], into: str) -> None:
    import subprocess

    folders = dict.fromkeys(os.path.dirname(path) for path in paths)
    options = [f"--proto_path={folder}" for folder in folders] + [f"--python_out={into}"]
    command = [*_compiler(), *options, *paths]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr or done.stdout).strip()
        raise RuntimeError(f"`protobufs` cannot be compiled:\n{reason}")


def _compiler() -> list[str]:
    if importlib.util.find_spec("grpc_tools") is not None:
        return [sys.executable, "-m", "grpc_tools.protoc"]
    import shutil

    compiler = shutil.which("protoc")
    if compiler is None:
        raise RuntimeError(
            "`protobufs` needs the compiler of Protocol Buffers, and neither the package "
            f"grpcio-tools nor protoc is installed; the first is to be had by: {_PACKAGE}"
        )
    return [compiler]


def _require_runtime(what: str) -> None:
    try:
        importlib.import_module("google.protobuf")
    except ImportError:
        raise RuntimeError(
            f"{what} needs the package protobuf, which is not installed: {_PACKAGE}"
        ) from None
