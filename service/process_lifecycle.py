"""Lifecycle of a service process. It either owns the farm, or is a standby: it waits until it can take over the farm.

If a process loses the farm to another one, it becomes a standby again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable

from renderer import __version__
from renderer.printable import printable
from renderer.sentences import Sentence
from service.errors import FarmError, NotOwner, StartupError
from service.farm import Farm
from service.ownership.candidate import Candidate
from service.ownership.ownership import Ownership
from service.settings import Settings
from telemetry import tracing
from telemetry.log_lines import uses_json

__all__ = ["REFUSES_TO_START", "ServiceLifecycle"]

TAKEOVER_ATTEMPT_EVERY_S = 0.1
REFUSES_TO_START = 3  # uvicorn's exit code for a failed start
EXIT_FAULT = 1

log = logging.getLogger(__name__)


class ServiceLifecycle:
    """Switches a service process between owning the farm and being a standby. Used only on one event loop."""

    def __init__(self, settings: Settings, take_over: Callable[[Farm], None]) -> None:
        """Stores the parameters.

        take_over: called with the Farm each time this process has become the owner, before requests are handled with it.
        """
        self._settings = settings
        self._take_over = take_over
        self._candidate: Candidate | None = None
        self._farm: Farm | None = None
        self._lost = asyncio.Event()
        self.taken = asyncio.Event()  # set while this service owns the farm
        self._task: asyncio.Task[None] | None = None
        self._has_printed = False
        self._trouble = ""  # why it is unknown whether this service must take over

    async def begin(self) -> None:
        """Becomes the owner of the farm, or a standby if another process is the owner. Raises StartupError."""
        self._candidate = Candidate(self._settings)
        try:
            owning = self._candidate.attempt()
        except StartupError:
            raise
        except FarmError as error:  # the database is unreachable, or locked by a suspended service
            owning, self._trouble = None, str(error)
        if owning is not None:
            self._start_farm(owning)
        else:
            log.warning("%s", self.standby_reason)
        self._task = asyncio.create_task(self._run())

    async def stop(self) -> None:
        """Stops the farm if this process owns it; otherwise stops being a standby."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        if self._farm is not None:
            await asyncio.to_thread(self._farm.stop)
        elif self._candidate is not None:
            self._candidate.close()

    @property
    def is_standby(self) -> bool:
        """Returns True if another service owns the farm, as far as this process knows."""
        return self._farm is None or self._farm.owning.is_lost

    @property
    def is_alive(self) -> bool:
        """Returns True if the task that switches the roles is running and, in the owner, the engine too."""
        goes_on = self._task is not None and not self._task.done()
        return goes_on and (self._farm is None or self._farm.engine.is_alive)

    @property
    def standby_reason(self) -> str:
        """The message for clients while this process is a standby: which process owns the farm."""
        known = self._candidate.known if self._candidate is not None else None
        if known is None and self._trouble:
            return Sentence("service-not-begun", "This service has not started: {reason}", reason=self._trouble)
        if known is not None and known.owner is not None:
            return Sentence(
                "service-stands-by-for",
                "This service stands by: another service ({place}) owns the farm. It takes over when that one ends or hangs.",
                place=known.place,
            )
        return Sentence(
            "service-stands-by",
            "This service stands by: another service owns the farm. It takes over when that one ends or hangs.",
        )

    @property
    def owner_url(self) -> str:
        """URL of the service that owns the farm; empty if it is unknown."""
        known = self._candidate.known if self._candidate is not None else None
        return known.url if known is not None and known.owner is not None else ""

    async def confirm(self) -> None:
        """Checks that this service still owns the farm, e.g. after it was suspended. Raises NotOwner or Unavailable."""
        farm = self._farm
        if farm is None:
            raise NotOwner
        if farm.owning.is_doubtful:
            await asyncio.to_thread(farm.owning.guard)

    def close_streams(self) -> None:
        """Ends the event streams to clients before the server stops. May be called in a signal handler."""
        if self._farm is not None:
            self._farm.broadcast.close()

    def _start_farm(self, owning: Ownership) -> None:
        """Starts the farm with this ownership. Raises StartupError, and makes this process a standby again, if that fails."""
        self._lost.clear()
        loop = asyncio.get_running_loop()
        try:
            farm = Farm(self._settings, owning)
        except BaseException:
            owning.stop()
            self._candidate = Candidate(self._settings)
            raise
        tracing.start_tracing("rayfarm-service", farm.instance, __version__)

        def lose() -> None:
            loop.call_soon_threadsafe(self._lost.set)

        farm.start(loop, lose)
        self._take_over(farm)
        self._farm, self._candidate = farm, None
        self.taken.set()
        if self._settings.print_link and farm.access.needs_login and not self._has_printed:
            self._print_login_link(farm)

    def _print_login_link(self, farm: Farm) -> None:
        self._has_printed = True
        link = f"{self._settings.page_url}/#/login?code={farm.access.owner_link()}"
        said = f"Log in, once, within a day: {link}"
        log.warning(said) if uses_json() else print(printable(said))

    async def _run(self) -> None:
        try:
            await self._alternate_roles()
        except Exception:
            log.critical("the service cannot go on, and ends", exc_info=True)
            os._exit(EXIT_FAULT)

    async def _alternate_roles(self) -> None:
        while True:
            if self._farm is None:
                await self._stand_by()
            await self._lost.wait()
            self.taken.clear()
            farm, self._farm = self._farm, None
            assert farm is not None
            farm.broadcast.close()
            await asyncio.to_thread(farm.stop)
            self._candidate = Candidate(self._settings)

    async def _stand_by(self) -> None:
        """Waits until this process becomes the owner of the farm, and starts the farm. Ends the process if it never can."""
        said = ""
        while True:
            assert self._candidate is not None
            try:
                owning = await asyncio.to_thread(self._candidate.attempt)
                self._trouble = ""
                if owning is not None:
                    self._start_farm(owning)
                    return
            except StartupError as error:
                log.critical("%s", error)
                os._exit(REFUSES_TO_START)  # the server offers no other way to end with an exit code
            except Exception as error:
                self._trouble = str(error)
                if str(error) != said:
                    said = str(error)
                    log.warning(
                        "stands by; the owner of the farm cannot be determined: %s",
                        error,
                        exc_info=not isinstance(error, FarmError),
                    )
            await asyncio.sleep(TAKEOVER_ATTEMPT_EVERY_S)
