"""Tests of kernel compilation by several processes: which process compiles, and which wait."""

import threading
import time

import pytest

from renderer import jit, machine_code


def test_one_process_compiles_and_others_load_concurrently(monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    together = threading.Barrier(2, timeout=30)
    order = []

    def load():
        with jit.compiling("kernel"):
            order.append("loads")
            together.wait()  # neither waits for the other

    others = [threading.Thread(target=load) for _ in range(2)]
    with jit.compiling("kernel"):
        for other in others:
            other.start()
        time.sleep(0.3)
        order.append("compiled")
    for other in others:
        other.join(30)
    assert order == ["compiled", "loads", "loads"]
    assert not together.broken


def test_kernel_file_list_is_extended(monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(jit, "_ready", set())
    for names in ({"b.code"}, {"a.code"}, set()):
        with jit.compiling("kernel"):
            machine_code._noted.update(tmp_path / name for name in names)
    assert (tmp_path / "kernel.done").read_text().split() == ["a.code", "b.code"]
    assert jit.is_ready("kernel")
    assert not jit.is_ready("another")


def test_failed_compilation_is_not_recorded(monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    with pytest.raises(ZeroDivisionError), jit.compiling("kernel"):
        _ = 1 / 0
    assert not list(tmp_path.glob("*.done"))


def test_waiting_process_compiles_after_a_timeout(monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(jit, "COMPILE_PATIENCE_S", 0.3)
    entered = threading.Event()

    def wait():
        with jit.compiling("kernel"):
            entered.set()

    with jit.compiling("kernel"):  # as after a process that was stopped during compilation
        other = threading.Thread(target=wait)
        other.start()
        assert entered.wait(30)
        other.join(30)
