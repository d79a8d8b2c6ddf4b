"""Conditions of actions, as in ``launch.conditions``."""

from __future__ import annotations

from hprm.ros._launch._entities import (
    Condition,
    LaunchContext,
    SomeText,
    described,
    normalized,
    perform,
    truth,
)
from hprm.ros._launch._plans import LaunchError as InvalidConditionExpressionError


def evaluate_condition_expression(context: LaunchContext, expression: SomeText) -> bool:
    """Return what an expression says: true, 1, false or 0."""
    return truth(perform(context, expression), f"the condition {described(expression)}")


class IfCondition(Condition):
    """An action counts if an expression is true."""

    def __init__(self, predicate_expression: SomeText) -> None:
        """Take the expression."""
        expression = normalized(predicate_expression)
        super().__init__(
            predicate=lambda context: evaluate_condition_expression(context, expression)
        )


class UnlessCondition(Condition):
    """An action counts if an expression is false."""

    def __init__(self, predicate_expression: SomeText) -> None:
        """Take the expression."""
        expression = normalized(predicate_expression)
        super().__init__(
            predicate=lambda context: not evaluate_condition_expression(context, expression)
        )


class LaunchConfigurationEquals(Condition):
    """An action counts if a configuration has a value; ``None`` means that it does not exist."""

    def __init__(self, launch_configuration_name: str, expected_value: SomeText | None) -> None:
        """Take the name and the value."""
        super().__init__(
            predicate=lambda context: _equals(context, launch_configuration_name, expected_value)
        )


class LaunchConfigurationNotEquals(Condition):
    """An action counts if a configuration does not have a value."""

    def __init__(self, launch_configuration_name: str, expected_value: SomeText | None) -> None:
        """Take the name and the value."""
        super().__init__(
            predicate=lambda context: (
                not _equals(context, launch_configuration_name, expected_value)
            )
        )


def _equals(context: LaunchContext, name: str, expected: SomeText | None) -> bool:
    context.plan.known.add(name)
    value = context.launch_configurations.get(name)
    return value == (None if expected is None else perform(context, expected))


__all__ = [
    "IfCondition",
    "InvalidConditionExpressionError",
    "LaunchConfigurationEquals",
    "LaunchConfigurationNotEquals",
    "UnlessCondition",
    "evaluate_condition_expression",
]
