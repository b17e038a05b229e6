"""The Redis commands that a worker may send over a channel (protocol/channel.py), and the keys that it may use.

Anyone with a worker token can send any bytes over a channel. So a worker may take messages from the queues that workers share,
but put messages only into its own queue; it may write only reports of its own name, and results only in its name. It can read
neither results nor other workers' reports. What it may say about a batch, a scene or a view needs the id of that message, which
only the worker that took the message knows.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from protocol.card import CARD_QUEUES
from protocol.channel import HTTPS
from protocol.contract import RESULTS, WorkerReport, pause_key, prepare_queue, recall_key, worker_key
from protocol.explained import explained_key
from protocol.joint import HELP_QUEUES
from protocol.lifeline import lifeline
from protocol.redis_commands import Command, CommandError
from protocol.terms import offer_key, terms_key
from protocol.view_parts import CARD_VIEW_QUEUES, MAX_ANSWERS, VIEW_ANSWERS, view_key
from protocol.vitals import log_key, log_wanted_key, vitals_key
from renderer.sentences import Sentence

__all__ = ["WorkerCommands"]

QUEUES = "rayfarm."
BINDINGS = ("_kombu.binding.", "_kombu.binding_permanent.")  # which queues an exchange has
SEPARATOR = "\x06\x16"  # in kombu's bindings, and between a queue and a priority
DEATHS = "rayfarm:deaths:"
JOINING = "rayfarm:joining"
OWN_PREPARE_MARK = ".of."
OWN_QUEUES = (HELP_QUEUES, CARD_QUEUES, CARD_VIEW_QUEUES)  # each of which only one worker serves
LIFELINES = "rayfarm-worker-"
MAX_BLOCK_S = 60.0
MAX_KEY_BYTES = 512
MAX_ARGUMENTS = 1024  # BRPOP names each queue four times, once for each priority
MIN_TTL_S, MAX_TTL_S = 10, 3600
MAX_TEXT_BYTES = 8 << 20  # of a report or an event, which are parsed
PLAIN = ("PING", "MULTI", "EXEC", "DISCARD", "UNWATCH", "QUIT")  # commands without keys


class WorkerCommands:
    """Checks the commands of one channel. suffix: what the name of the worker ends with."""

    def __init__(self, suffix: str) -> None:
        self._suffix = suffix
        self._lifeline: str | None = None  # a connection's name, to be confirmed by the report that follows it
        own, read = (self._is_own_report, self._is_own_queue), (self._is_own_queue, self._is_shared_queue)
        self._rules: dict[str, tuple[Callable[[list[str]], list[str]], tuple[Callable[[str], bool], ...]]] = {
            "BRPOP": (_all_but_last, read),
            "LLEN": (_first, read),
            "LPUSH": (_first, (self._is_own_queue,)),
            "RPUSH": (_first, (self._is_own_queue, _is_answer_list)),
            "LTRIM": (_first, (_is_answer_list,)),
            "EXPIRE": (_first, (_is_answer_list, _is_counter)),
            "SADD": (_first, (self._is_binding,)),
            "SMEMBERS": (_first, (self._is_binding,)),
            "XLEN": (_first, (_is_results,)),
            "XADD": (_first, (_is_results,)),
            "SET": (_first, (*own, _is_joining)),
            "GET": (_first, (*own, self._is_own_order, _is_view)),
            "EXISTS": (_all, (*own, self._is_own_order, _is_recall)),
            "DEL": (_all, (*own, _is_counter)),
            "UNLINK": (_all, (*own, _is_counter)),
            "INCR": (_first, (_is_counter,)),
            "INCRBY": (_first, (_is_counter,)),
        }

    @property
    def has_unconfirmed_name(self) -> bool:
        """Returns True if the last command named the connection after a worker, and that worker's report has not followed yet."""
        return self._lifeline is not None

    def check(self, command: Command) -> None:
        """Raises CommandError with a sentence if a worker may not send this command."""
        name, arguments = command.name, command.arguments[1:]
        is_report = name == "SET" and bool(arguments) and _text(arguments[0]).startswith(worker_key(""))
        if self._lifeline is not None and not is_report:
            raise _refused(name)
        if name in PLAIN:
            return
        if name in ("HELLO", "CLIENT"):
            self._check_connection_command(name, arguments)
            return
        if name not in self._rules or not arguments:
            raise _refused(name)
        keys_of, permitted = self._rules[name]
        texts = [_text(argument) for argument in arguments[:MAX_ARGUMENTS]]
        keys = keys_of(texts)
        if not keys or len(arguments) > MAX_ARGUMENTS:
            raise _refused(name)
        for key in keys:
            if not any(allows(key) for allows in permitted):
                raise CommandError(
                    Sentence(
                        "channel-key-refused",
                        "A worker that joins over HTTPS may not use {key} with Redis's command {command}. Run the same release "
                        "of Rayfarm on all machines.",
                        key=key[:80],
                        command=name,
                    )
                )
        self._check_values(name, keys[0], texts, arguments)

    def _check_connection_command(self, name: str, arguments: list[bytes]) -> None:
        texts = [_text(argument).upper() for argument in arguments[:3]]
        if name == "HELLO" and len(arguments) == 1 and texts[0] in ("2", "3"):
            return
        if name == "CLIENT" and texts and texts[0] in ("SETINFO", "GETNAME", "ID", "MAINT_NOTIFICATIONS"):
            return
        if name == "CLIENT" and texts and texts[0] == "SETNAME" and len(arguments) == 2:
            wanted = _text(arguments[1])
            if wanted.startswith(LIFELINES):
                self._lifeline = wanted
            return
        raise _refused(f"{name} {texts[0][:20]}" if texts else name)

    def _check_values(self, name: str, key: str, texts: list[str], arguments: list[bytes]) -> None:
        match name:
            case "SET" if not (len(texts) == 4 and texts[2].upper() == "EX" and _is_number_below(texts[3], MAX_TTL_S)):
                raise _refused("SET")  # without an expiry
            case "SET" if key.startswith(worker_key("")):
                self._check_report(key, arguments[1])
            case "XADD":
                self._check_result(texts, arguments)
            case "SADD":
                if not all(each.split(SEPARATOR)[-1] == _bound_queue(key) for each in texts[1:]):
                    raise _refused("SADD")
            case "BRPOP" if not _is_number_below(texts[-1], MAX_BLOCK_S):
                raise _refused("BRPOP 0")
            case "EXPIRE" if not (len(texts) == 2 and _is_number_below(texts[1], MAX_TTL_S) and float(texts[1]) >= MIN_TTL_S):
                raise _refused("EXPIRE")
            case "LTRIM" if texts[1:] != [str(-MAX_ANSWERS), "-1"]:
                raise _refused("LTRIM")  # would remove the answers of others

    def _check_report(self, key: str, value: bytes) -> None:
        """Raises CommandError unless `value` is a report of the worker of this key, and follows its lifeline if there is one."""
        name, announced = key.removeprefix(worker_key("")), self._lifeline
        self._lifeline = None
        if len(value) > MAX_TEXT_BYTES:
            raise _refused("SET")
        try:
            report = WorkerReport.from_bytes(value)
        except ValueError as error:
            raise CommandError(str(error)) from None
        if report.name != name or report.transport != HTTPS or announced not in (None, lifeline(name)):
            raise CommandError(
                Sentence(
                    "channel-report-refused",
                    "The report of worker {name} is not one of a worker that joins over HTTPS.",
                    name=name[:80],
                )
            )

    def _check_result(self, texts: list[str], arguments: list[bytes]) -> None:
        """Raises CommandError unless the arguments append one event in this worker's name."""
        if texts[1:2] != ["*"] or texts[2:5:2] not in (["event"], ["event", "sums"]) or len(texts) not in (4, 6):
            raise _refused("XADD")
        try:
            event = json.loads(arguments[3]) if len(arguments[3]) <= MAX_TEXT_BYTES else None
        except (ValueError, RecursionError):
            event = None
        if not isinstance(event, dict) or not self._is_own_event(event):
            raise CommandError(
                Sentence("channel-result-refused", "A result is not in the name of the worker that sends it, or malformed.")
            )

    def _is_own_event(self, event: dict[str, Any]) -> bool:
        if event.get("type") == "wake":
            return len(event) == 1
        worker, parts = event.get("worker"), event.get("parts", [])
        if not isinstance(worker, str) or not worker or not self._is_own_name(worker) or not isinstance(parts, list):
            return False
        # A fifth element names another worker of a site (protocol/joint.py).
        return all(isinstance(part, list) and len(part) <= 4 for part in parts)

    def _is_own_name(self, name: str) -> bool:
        return len(name) > len(self._suffix) and name.endswith(self._suffix)

    def _is_own(self, key: str, prefix: str) -> bool:
        return key.startswith(prefix) and self._is_own_name(key.removeprefix(prefix))

    def _is_own_report(self, key: str) -> bool:
        return any(self._is_own(key, of("")) for of in (worker_key, offer_key, vitals_key, log_key))

    def _is_own_order(self, key: str) -> bool:
        return any(self._is_own(key, of("")) for of in (pause_key, terms_key, log_wanted_key))

    def _is_own_queue(self, key: str) -> bool:
        """Returns True for queues that only one worker serves, if it is this one."""
        key = key.partition(SEPARATOR)[0]
        if key.startswith(prepare_queue("")) and OWN_PREPARE_MARK in key:
            return self._is_own_name(key.partition(OWN_PREPARE_MARK)[2])
        return any(self._is_own(key, queues) for queues in OWN_QUEUES)

    def _is_shared_queue(self, key: str) -> bool:
        is_of_one = key.startswith(OWN_QUEUES) or (key.startswith(prepare_queue("")) and OWN_PREPARE_MARK in key)
        return key.startswith(QUEUES) and not is_of_one

    def _is_binding(self, key: str) -> bool:
        queue = _bound_queue(key)
        return self._is_own_queue(queue) or self._is_shared_queue(queue)


def _bound_queue(key: str) -> str:
    """Returns the queue to which kombu's binding key belongs, since each of our exchanges has one queue; "" for other keys."""
    return next((key.removeprefix(prefix) for prefix in BINDINGS if key.startswith(prefix)), "")


def _is_results(key: str) -> bool:
    return key == RESULTS


def _is_answer_list(key: str) -> bool:
    return key == VIEW_ANSWERS or key.startswith(explained_key(""))


def _is_counter(key: str) -> bool:
    return key.startswith(DEATHS)


def _is_joining(key: str) -> bool:
    return key == JOINING


def _is_view(key: str) -> bool:
    return key.startswith(view_key(""))


def _is_recall(key: str) -> bool:
    return key.startswith(recall_key(""))


def _first(arguments: list[str]) -> list[str]:
    return arguments[:1]


def _all(arguments: list[str]) -> list[str]:
    return arguments


def _all_but_last(arguments: list[str]) -> list[str]:
    return arguments[:-1]


def _is_number_below(text: str, most: float) -> bool:
    """Returns True if the text is a number above 0 and at most `most`."""
    try:
        return 0 < float(text) <= most
    except ValueError:
        return False


def _text(argument: bytes) -> str:
    """Returns a key or another short argument as text; "" for a long value."""
    return argument.decode("utf-8", "replace") if len(argument) <= MAX_KEY_BYTES else ""


def _refused(command: str) -> CommandError:
    return CommandError(
        Sentence(
            "channel-command-refused",
            "A worker that joins over HTTPS may not send Redis's command {command}. Run the same release of Rayfarm on all "
            "machines.",
            command=command[:40],
        )
    )
