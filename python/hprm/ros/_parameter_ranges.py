"""Which numbers a parameter may have, as its descriptor states."""

from __future__ import annotations

from typing import Any

from hprm.ros.parameter import Parameter


def out_of_range(parameter: Parameter, descriptor: Any) -> str | None:
    """Say why a parameter may not have its value, if it may not."""
    ranges = {
        Parameter.Type.INTEGER: descriptor.integer_range,
        Parameter.Type.DOUBLE: descriptor.floating_point_range,
    }.get(parameter.type_, [])
    for it in ranges:
        low, high, step = it.from_value, it.to_value, it.step
        value = parameter.value
        if not (low <= value <= high or _near(value, low) or _near(value, high)):
            return (
                f"Parameter {parameter.name} out of range. Min: {low}, Max: {high}, value: {value}"
            )
        if (
            step
            and not _near(value, high)
            and not _near(round((value - low) / step) * step + low, value)
        ):
            return (
                f"The parameter value for {parameter.name} is not a valid step. Min: {low}, Max:"
                f" {high}, value: {value}, step: {step}"
            )
    return None


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= 1e-9 * max(abs(one), abs(other), 1.0)
