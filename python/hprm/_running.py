"""What every reactor can do while it runs: time, tags, and requests to its runtime."""

from __future__ import annotations

from hprm import _construction
from hprm._duration import Time
from hprm._hprm import Api, Tag, nanoseconds


class Running:
    """What a body asks of its reactor; times are nanoseconds.

    Outside of a run, these raise ``RuntimeError``.
    """

    @property
    def bank_index(self) -> int:
        """The position in its bank, from zero; zero as well if it is in none."""
        return _construction.of(self).member or 0  # type: ignore[arg-type]

    def tag(self) -> Tag:
        """Return the current tag, with its time since the Unix epoch."""
        return _api(self).tag()

    def logical_time(self) -> int:
        """Return the time of the current tag, in nanoseconds since the Unix epoch."""
        return _api(self).logical()

    def elapsed(self) -> int:
        """Return the time of the current tag, in nanoseconds since the start of the program."""
        return _api(self).logical_elapsed()

    def physical_time(self) -> int:
        """Return what the clock shows, in nanoseconds since the Unix epoch."""
        return _api(self).physical()

    def lag(self) -> int:
        """Return by how many nanoseconds the clock is ahead of the current tag."""
        return self.physical_time() - self.logical_time()

    def request_stop(self) -> None:
        """End the program at the next microstep; reactions to ``shutdown`` run then.

        The federates of a federation agree on the tag.
        """
        _api(self).request_stop()

    def leave(self) -> None:
        """End this federate at its next microstep; the other federates continue.

        Its reactions to ``shutdown`` run then. A program without federates ends.
        """
        _api(self).stop()

    def missed_deadline(self) -> bool:
        """Return whether the deadline of the running reaction has passed by now.

        No handler runs for that.
        """
        return _api(self).check_deadline(False)

    def set_deadline(self, deadline: Time) -> None:
        """Change the deadline of the running reaction, from now on.

        Parameters
        ----------
        deadline : Time
            How long after its tag the reaction may begin.

        """
        _api(self).update_deadline(nanoseconds(deadline))


def _api(reactor: Running) -> Api:
    try:
        api: Api = reactor._hprm_api_  # type: ignore[attr-defined]
    except AttributeError:
        name = type(reactor).__name__
        message = f"this {name} does not run here; a reaction of it can ask for that"
        raise RuntimeError(message) from None
    return api
