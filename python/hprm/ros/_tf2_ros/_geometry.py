"""Rotations and transforms of single points: plain numbers, which for four of them are quickest.

A quaternion is ``(x, y, z, w)`` and has the length 1. A transform takes points of a child frame
into its parent frame: it rotates, then moves.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]

# Below this angle, slerp would divide by nearly nothing, and lerp is as exact.
_SMALL = 1e-9


class Rigid(NamedTuple):
    """A rotation, and a translation after it."""

    translation: Vector
    rotation: Quaternion


IDENTITY = Rigid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def product(left: Quaternion, right: Quaternion) -> Quaternion:
    """Return the rotation that is ``right`` and then ``left``."""
    ax, ay, az, aw = left
    bx, by, bz, bw = right
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(rotation: Quaternion) -> Quaternion:
    """Return the rotation back."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def rotate(rotation: Quaternion, vector: Vector) -> Vector:
    """Return a rotated vector."""
    x, y, z, w = rotation
    vx, vy, vz = vector
    # v + 2w (q x v) + 2 q x (q x v), with the cross product q x v written out.
    cx, cy, cz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    return (
        vx + 2.0 * (w * cx + y * cz - z * cy),
        vy + 2.0 * (w * cy + z * cx - x * cz),
        vz + 2.0 * (w * cz + x * cy - y * cx),
    )


def normalized(rotation: Quaternion) -> Quaternion:
    """Return a quaternion of length 1; one of length 0 is no rotation."""
    length = math.hypot(*rotation)
    if length == 0.0:
        return IDENTITY.rotation
    x, y, z, w = rotation
    return x / length, y / length, z / length, w / length


def slerp(begin: Quaternion, end: Quaternion, ratio: float) -> Quaternion:
    """Return the rotation on the shorter way from one to another, at constant speed."""
    cosine = sum(a * b for a, b in zip(begin, end, strict=True))
    # A quaternion and its negative are one rotation.
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < _SMALL:
        first, second = 1.0 - ratio, ratio * sign
    else:
        first = math.sin((1.0 - ratio) * angle) / math.sin(angle)
        second = sign * math.sin(ratio * angle) / math.sin(angle)
    return normalized(
        (
            first * begin[0] + second * end[0],
            first * begin[1] + second * end[1],
            first * begin[2] + second * end[2],
            first * begin[3] + second * end[3],
        )
    )


def apply(transform: Rigid, point: Vector) -> Vector:
    """Return a point of the child frame in the parent frame."""
    x, y, z = rotate(transform.rotation, point)
    dx, dy, dz = transform.translation
    return x + dx, y + dy, z + dz


def compose(outer: Rigid, inner: Rigid) -> Rigid:
    """Return the transform that is ``inner`` and then ``outer``."""
    return Rigid(apply(outer, inner.translation), product(outer.rotation, inner.rotation))


def inverse(transform: Rigid) -> Rigid:
    """Return the transform back."""
    back = conjugate(transform.rotation)
    x, y, z = rotate(back, transform.translation)
    return Rigid((-x, -y, -z), back)


def interpolate(begin: Rigid, end: Rigid, ratio: float) -> Rigid:
    """Return what lies between two transforms: on a straight line, turned evenly."""
    (ax, ay, az), (bx, by, bz) = begin.translation, end.translation
    return Rigid(
        (ax + (bx - ax) * ratio, ay + (by - ay) * ratio, az + (bz - az) * ratio),
        slerp(begin.rotation, end.rotation, ratio),
    )
