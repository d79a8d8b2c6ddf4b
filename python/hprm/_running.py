"""What every reactor can do while it runs: time, tags, and requests to its runtime."""

from __future__ import annotations

from hprm import _construction
from hprm._duration import Time
from hprm._hprm import Api, Tag, nanoseconds


class Running:
    """The methods of reactors that run; times are in nanoseconds."""

    @property
    def bank_index(self) -> int:
        """The position in its bank; zero if it is in none."""
        return _construction.of(self).member or 0  # type: ignore[arg-type]

    def tag(self) -> Tag:
        """Return the current tag."""
        return _api(self).tag()

    def logical_time(self) -> int:
        """Return the time of the current tag, since the Unix epoch."""
        return _api(self).logical()

    def elapsed(self) -> int:
        """Return the time of the current tag, since the start of the program."""
        return _api(self).logical_elapsed()

    def physical_time(self) -> int:
        """Return what the clock shows, since the Unix epoch."""
        return _api(self).physical()

    def lag(self) -> int:
        """Return by how much the clock is ahead of the current tag."""
        return self.physical_time() - self.logical_time()

    def request_stop(self) -> None:
        """End the program at the next tag."""
        _api(self).request_stop()

    def leave(self) -> None:
        """End this federate at the next tag; the other federates continue."""
        _api(self).stop()

    def missed_deadline(self) -> bool:
        """Tell whether the deadline of the running reaction has passed; no handler runs."""
        return _api(self).check_deadline(False)

    def set_deadline(self, deadline: Time) -> None:
        """Change the deadline of the running reaction, from now on."""
        _api(self).update_deadline(nanoseconds(deadline))


def _api(reactor: Running) -> Api:
    api: Api | None = vars(reactor).get("_hprm_api_")
    if api is None:
        name = type(reactor).__name__
        raise RuntimeError(f"this {name} does not run here; a reaction of it can ask for that")
    return api
