"""Bulkheads: contain an error of one job or scene, so that the others continue.

Every step that the engine takes for a job or a scene runs through `Bulkheads.run`, the one place that attributes errors:

Redis             raised: without the queue no work is possible, and the whole engine waits for it.
the database      not the job's fault. The step is retried about once a second; steps that need no database continue.
FilmUnavailable   the job waits and shows the reason. The step is retried about once a second.
the machine       out of memory or file descriptors, or a failing disk: handled like FilmUnavailable.
all others        the job's own fault: the job gets a verdict, an error with which `Lifecycle.fail` ends it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import redis
from sqlalchemy import exc

from renderer.errors import SettingsError
from renderer.library_messages import library_message
from renderer.sentences import Sentence, in_lower_case
from service.clock import Clock
from service.errors import FarmError, FilmUnavailable, Invalid, OutOfSpace, QueueError, Unavailable
from telemetry.log_lines import about, ids

__all__ = ["Bulkheads", "Step", "Verdict", "is_message_fault"]

RETRY_S = 1.0
RETRY_AT_MOST_S = 5.0
RETRY_FACTOR = 10  # a slowly failing step, such as one waiting for a lock, is retried after this multiple of its duration

DATABASE_FAULTS = (exc.DBAPIError, exc.TimeoutError)
# Errors of a row, not of the database.
ROW_FAULTS = (exc.IntegrityError, exc.ProgrammingError, exc.DataError, exc.NotSupportedError)

log = logging.getLogger(__name__)


def is_message_fault(error: Exception) -> bool:
    """Returns True if an error was caused by the message that was being handled.

    Returns False for errors of Redis, the database, the machine, a film or a job, which the next message would cause too.
    """
    if isinstance(error, (Invalid, *ROW_FAULTS)):
        return True
    return not isinstance(error, (FarmError, SettingsError, redis.RedisError, QueueError, OSError, MemoryError, *DATABASE_FAULTS))


class Step(StrEnum):
    """A step that the engine takes for a job or a scene. After an error, each step is retried independently of the others."""

    CHANGE = "change"  # apply its row of the database
    RESULTS = "results"  # store workers' answers
    HAND_OUT = "hand out"
    RECORD = "record"  # store its progress, and finish it
    END = "end"  # carry out a verdict


@dataclass(frozen=True)
class Verdict:
    """The error that ends a job. reproduce: the command line that reproduces it, or None."""

    error: str
    reproduce: str | None = None


@dataclass(frozen=True)
class _Delay:
    sentence: str
    until: float


class Bulkheads:
    """Delayed steps and verdicts of jobs and scenes. A verdict is the error that ends a job. Used only by the engine's thread."""

    def __init__(self, clock: Clock = time) -> None:
        self._clock = clock
        self._waits: dict[str, dict[Step, _Delay]] = {}
        self.verdicts: dict[str, Verdict] = {}  # not carried out yet
        self.database_fault: str | None = None
        self._database_until = 0.0

    def run(self, id: str, step: Step, action: Callable[[], object], needs_database: bool = False) -> bool:
        """Runs a step of a job or scene. Returns whether it succeeded.

        After an error, the step is delayed, or the job gets a verdict. needs_database: whether to skip the step while the
        database is unavailable. Raises only redis.RedisError and QueueError.
        """
        if id in self.verdicts or not self._is_due(id, step, needs_database):
            return False
        return self._attempt(id, step, action, needs_database)

    def end_failed_jobs(self, end: Callable[[str, Verdict], object]) -> None:
        """Calls `end` with the id and the verdict of each failed job, unless the database is unavailable.

        Raises redis.RedisError and QueueError.
        """
        for id, verdict in list(self.verdicts.items()):
            if not self._is_due(id, Step.END, True):
                continue
            ended = self._attempt(id, Step.END, partial(end, id, verdict), True)
            if ended or Step.END not in self._waits.get(id, {}):
                self.remove_id(id)

    def _attempt(self, id: str, step: Step, action: Callable[[], object], needs_database: bool) -> bool:
        began = self._clock.monotonic()
        try:
            with about(owner=id):
                action()
        except (redis.RedisError, QueueError):
            raise
        except FilmUnavailable as error:
            self._delay(id, step, error.fact, began)
        except (OutOfSpace, Unavailable) as error:
            self._delay_for_database(id, step, error.fact, began)
        except DATABASE_FAULTS as error:
            if isinstance(error, ROW_FAULTS):
                self._fail_owner(id, step, error)
            else:
                self._delay_for_database(
                    id,
                    step,
                    Sentence(
                        "database-unusable",
                        "The database cannot be used ({reason}).",
                        reason=library_message(getattr(error, "orig", None) or error),
                    ),
                    began,
                )
        except (OSError, MemoryError) as error:
            self._delay(
                id,
                step,
                Sentence(
                    "service-machine-error",
                    "The service's machine has a problem ({name}: {error}).",
                    name=type(error).__name__,
                    error=library_message(error),
                ),
                began,
            )
        except Exception as error:
            self._fail_owner(id, step, error)
        else:
            self._clear_delay(id, step, needs_database)
            return True
        return False

    def give_verdict(self, id: str, error: str, reproduce: str | None = None) -> None:
        """Sets the error that ends a job, unless the job already has one. reproduce: command line that reproduces the error."""
        self.verdicts.setdefault(id, Verdict(error, reproduce))

    def may_render(self, id: str) -> bool:
        """Returns True if batches of a job may be dispatched: it has not failed, and its film accepts results."""
        waits = self._waits.get(id, {})
        return id not in self.verdicts and Step.RESULTS not in waits and self._is_due(id, Step.HAND_OUT, False)

    def waiting_reasons(self) -> dict[str, str]:
        """Returns the reasons why jobs and scenes wait, as sentences by id."""
        return {id: next(iter(waits.values())).sentence for id, waits in self._waits.items()}

    def remove_id(self, id: str) -> None:
        """Removes the state of a job or scene that has ended or was deleted."""
        self._waits.pop(id, None)
        self.verdicts.pop(id, None)

    def _is_due(self, id: str, step: Step, needs_database: bool) -> bool:
        now = self._clock.monotonic()
        if needs_database and now < self._database_until:
            return False
        wait = self._waits.get(id, {}).get(step)
        return wait is None or now >= wait.until

    def _delay_for_database(self, id: str, step: Step, sentence: str, began: float) -> None:
        self.database_fault = sentence
        self._delay(id, step, sentence, began)
        self._database_until = self._waits[id][step].until

    def _delay(self, id: str, step: Step, reason: str, began: float) -> None:
        sentence = Sentence("job-waits-because", "Waits: {reason}", reason=in_lower_case(reason))
        waits = self._waits.setdefault(id, {})
        if step not in waits:
            log.warning("%s: %s (%s)", id, sentence, step, extra=ids(owner=id))
        now = self._clock.monotonic()
        waits[step] = _Delay(sentence, now + min(max(RETRY_S, RETRY_FACTOR * (now - began)), RETRY_AT_MOST_S))

    def _clear_delay(self, id: str, step: Step, needs_database: bool) -> None:
        if needs_database and self.database_fault is not None:
            log.warning("the database is available again")
            self.database_fault = None
        waits = self._waits.get(id)
        if waits is not None and waits.pop(step, None) is not None:
            log.warning("%s goes on (%s)", id, step, extra=ids(owner=id))
            if not waits:
                del self._waits[id]

    def _fail_owner(self, id: str, step: Step, error: Exception) -> None:
        if isinstance(error, FarmError):
            sentence = str(error)
        elif isinstance(error, SettingsError):
            sentence = Sentence("job-not-continuable", "This job cannot continue: {error}. Make a new one.", error=error)
        else:
            log.error("%s cannot go on (%s)", id, step, exc_info=error, extra=ids(owner=id))
            sentence = Sentence(
                "job-service-fault",
                "The service failed on this job ({name}: {error}); see its log. Set the job to running to try again.",
                name=type(error).__name__,
                error=error,
            )
        self.give_verdict(id, sentence)
