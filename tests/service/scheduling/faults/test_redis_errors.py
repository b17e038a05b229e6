"""Tests of the error sentences for errors of Redis."""

from __future__ import annotations

import pytest
import redis

from service.errors import QueueError
from service.scheduling.faults.redis_errors import redis_fault


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            redis.ResponseError("BUSY Redis is busy running a script. You can only call SCRIPT KILL."),
            "Redis is blocked by a script that does not end",
        ),
        (redis.ReadOnlyError("You can't write against a read only replica."), "Redis accepts no writes: it is a replica"),
        (
            redis.ResponseError("Command # 1 (SET a) of pipeline caused error: READONLY You can't write"),
            "Redis accepts no writes: it is a replica",
        ),
        (redis.OutOfMemoryError("command not allowed when used memory > 'maxmemory'."), "is full"),
        (redis.ResponseError("MISCONF Redis is configured to save RDB snapshots, but it's unable to"), "cannot save"),
        (redis.BusyLoadingError("Redis is loading the dataset in memory"), "Redis is loading its data from disk"),
        (
            redis.AuthenticationError("invalid username-password pair or user is disabled."),
            "Redis rejects the service's password",
        ),
        (redis.exceptions.NoPermissionError("this user has no permissions to run the 'xadd' command"), "lacks permissions"),
        (redis.exceptions.NoScriptError("No matching script. Please use EVAL."), "A script is missing in Redis"),
        (
            redis.ResponseError("WRONGTYPE Operation against a key holding the wrong kind of value"),
            "A key in Redis has another type than the farm expects",
        ),
        (redis.ConnectionError("max number of clients reached"), "Redis has reached its limit of connections"),
        (redis.ResponseError("ERR unknown command 'XADD'"), "Redis does not support a command that the farm needs"),
        (redis.ResponseError("ERR something new"), "refuses a command"),
        (redis.ConnectionError("Error 111 connecting to 127.0.0.1:6379. Connection refused."), "does not answer"),
        (redis.TimeoutError("Timeout reading from socket"), "does not answer"),
    ],
)
def test_redis_errors_have_specific_messages(error: Exception, said: str) -> None:
    fact, remedy = redis_fault(error)
    assert said in fact
    assert "memory" not in remedy or said == "is full"
    try:
        raise QueueError(str(error)) from error
    except QueueError as of_the_queue:
        assert redis_fault(of_the_queue) == (fact, remedy)
