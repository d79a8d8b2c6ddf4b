"""Functions for actions and substitutions of users, as in ``launch.utilities``."""

from __future__ import annotations

from collections.abc import Iterable

from hprm.ros._launch._entities import LaunchContext, SomeText, Substitution
from hprm.ros._launch._entities import normalized as normalize_to_list_of_substitutions


def perform_substitutions(context: LaunchContext, subs: Iterable[Substitution] | SomeText) -> str:
    """Return the text that substitutions make together."""
    return "".join(each.perform(context) for each in normalize_to_list_of_substitutions(subs))


__all__ = ["normalize_to_list_of_substitutions", "perform_substitutions"]
